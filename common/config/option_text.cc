#include "common/config/option_text.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numeric>
#include <vector>

#include "absl/strings/numbers.h"
#include "common/base/concat.h"

namespace portolan {
namespace {

// Largest time that fits into nanoseconds.
constexpr double kMaxSeconds = 9.2e9;

template <typename Integer>
Status ParseInteger(const std::string& text, const char* expected, Integer* value) {
  if (!absl::SimpleAtoi(text, value)) {
    return absl::InvalidArgumentError(Concat("expected ", expected, ", not '", text, "'"));
  }
  return absl::OkStatus();
}

template <typename Float>
std::string ShortestText(Float value) {
  char buffer[64];
  const auto end = std::to_chars(buffer, buffer + sizeof(buffer), value);
  return std::string(buffer, end.ptr);
}

}  // namespace

Status ParseOptionText(const std::string& text, bool* value) {
  if (text == "true" || text == "false") {
    *value = text == "true";
    return absl::OkStatus();
  }
  return absl::InvalidArgumentError(Concat("expected true or false, not '", text, "'"));
}

Status ParseOptionText(const std::string& text, int32_t* value) {
  return ParseInteger(text, "a whole number", value);
}
Status ParseOptionText(const std::string& text, int64_t* value) {
  return ParseInteger(text, "a whole number", value);
}
Status ParseOptionText(const std::string& text, uint32_t* value) {
  return ParseInteger(text, "a whole number from 0 up", value);
}
Status ParseOptionText(const std::string& text, uint64_t* value) {
  return ParseInteger(text, "a whole number from 0 up", value);
}

Status ParseOptionText(const std::string& text, double* value) {
  double parsed;
  if (!absl::SimpleAtod(text, &parsed) || !std::isfinite(parsed)) {
    return absl::InvalidArgumentError(Concat("expected a number, not '", text, "'"));
  }
  *value = parsed;
  return absl::OkStatus();
}

Status ParseOptionText(const std::string& text, float* value) {
  float parsed;
  if (!absl::SimpleAtof(text, &parsed) || !std::isfinite(parsed)) {
    return absl::InvalidArgumentError(Concat("expected a number, not '", text, "'"));
  }
  *value = parsed;
  return absl::OkStatus();
}

Status ParseOptionText(const std::string& text, std::string* value) {
  *value = text;
  return absl::OkStatus();
}

Status ParseOptionText(const std::string& text, Duration* value) {
  double seconds;
  PORTOLAN_RETURN_IF_ERROR(ParseOptionText(text, &seconds));
  if (std::abs(seconds) > kMaxSeconds) {
    return absl::InvalidArgumentError(Concat("time of ", text, " s is out of range"));
  }
  *value = FromSeconds(seconds);
  return absl::OkStatus();
}

std::string OptionTextOf(bool value) { return value ? "true" : "false"; }
std::string OptionTextOf(int32_t value) { return std::to_string(value); }
std::string OptionTextOf(int64_t value) { return std::to_string(value); }
std::string OptionTextOf(uint32_t value) { return std::to_string(value); }
std::string OptionTextOf(uint64_t value) { return std::to_string(value); }
std::string OptionTextOf(double value) { return ShortestText(value); }
std::string OptionTextOf(float value) { return ShortestText(value); }
std::string OptionTextOf(const std::string& value) { return value; }
std::string OptionTextOf(Duration value) { return ShortestText(ToSeconds(value)); }

int EditDistance(std::string_view a, std::string_view b) {
  std::vector<int> row(b.size() + 1);
  std::iota(row.begin(), row.end(), 0);
  for (size_t i = 0; i < a.size(); ++i) {
    int diagonal = row[0];
    row[0] = static_cast<int>(i) + 1;
    for (size_t j = 0; j < b.size(); ++j) {
      const int replaced = diagonal + (a[i] == b[j] ? 0 : 1);
      diagonal = row[j + 1];
      row[j + 1] = std::min({replaced, row[j] + 1, row[j + 1] + 1});
    }
  }
  return row.back();
}

}  // namespace portolan
