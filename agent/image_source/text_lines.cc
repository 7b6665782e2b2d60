#include "agent/image_source/text_lines.h"

#include <algorithm>
#include <cmath>
#include <fstream>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_split.h"
#include "common/base/concat.h"

namespace portolan {
namespace {

constexpr double kMaxSeconds = 9.2e9;

std::vector<std::string> SplitFields(const std::string& line) {
  if (line.find(',') == std::string::npos) {
    return absl::StrSplit(line, absl::ByAnyChar(" \t"), absl::SkipEmpty());
  }
  std::vector<std::string> fields = absl::StrSplit(line, ',');
  for (std::string& field : fields) absl::StripAsciiWhitespace(&field);
  if (fields.back().empty()) fields.pop_back();  // a comma at the end
  return fields;
}

bool IsDigits(std::string_view text) {
  return !text.empty() &&
         std::all_of(text.begin(), text.end(), [](char c) { return c >= '0' && c <= '9'; });
}

Status NotATime(std::string_view text) {
  return absl::InvalidArgumentError(Concat("'", text, "' is not a time"));
}

}  // namespace

Status ForEachLine(const std::filesystem::path& path,
                   const std::function<Status(const std::vector<std::string>& fields)>& use) {
  std::ifstream file(path, std::ios::binary);
  if (!file) return absl::NotFoundError(Concat(path, ": cannot be opened"));
  std::string line;
  for (int number = 1; std::getline(file, line); ++number) {
    absl::StripAsciiWhitespace(&line);
    if (line.empty() || line.front() == '#') continue;
    const Status status = use(SplitFields(line));
    if (!status.ok()) {
      return Status(status.code(), Concat(path, ":", number, ": ", std::string(status.message())));
    }
  }
  if (file.bad()) return absl::DataLossError(Concat(path, ": cannot be read"));
  return absl::OkStatus();
}

StatusOr<Timestamp> ParseSeconds(std::string_view text) {
  const size_t dot = text.find('.');
  const std::string_view whole = text.substr(0, dot);
  std::string fraction(dot == std::string_view::npos ? "" : text.substr(dot + 1));
  if (IsDigits(whole) && whole.size() <= 10 && (fraction.empty() || IsDigits(fraction))) {
    fraction.resize(9, '0');
    int64_t seconds, nanoseconds;
    if (absl::SimpleAtoi(std::string(whole), &seconds) &&
        absl::SimpleAtoi(fraction, &nanoseconds) && seconds < kMaxSeconds) {
      return Timestamp(seconds * 1000000000 + nanoseconds);
    }
  }
  double value;
  if (!absl::SimpleAtod(std::string(text), &value) || !(std::abs(value) < kMaxSeconds)) {
    return NotATime(text);
  }
  return FromSeconds(value);
}

StatusOr<Timestamp> ParseNanoseconds(std::string_view text) {
  int64_t value;
  if (!absl::SimpleAtoi(std::string(text), &value)) return NotATime(text);
  return Timestamp(value);
}

StatusOr<double> ParseNumber(std::string_view text) {
  double value;
  if (!absl::SimpleAtod(std::string(text), &value) || !std::isfinite(value)) {
    return absl::InvalidArgumentError(Concat("'", text, "' is not a finite number"));
  }
  return value;
}

}  // namespace portolan
