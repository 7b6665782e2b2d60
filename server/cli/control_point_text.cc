#include "server/cli/control_point_text.h"

#include <cctype>
#include <cstdlib>
#include <sstream>

#include "common/base/concat.h"
#include "common/config/option_text.h"

namespace portolan {
namespace {

constexpr size_t kColumns = 7;

std::vector<std::string> Split(const std::string& text, char separator) {
  std::vector<std::string> parts;
  std::stringstream stream(text);
  std::string part;
  while (std::getline(stream, part, separator)) parts.push_back(part);
  if (!text.empty() && text.back() == separator) parts.emplace_back();
  return parts;
}

std::string Stripped(const std::string& text) {
  const size_t first = text.find_first_not_of(" \t\r");
  if (first == std::string::npos) return "";
  return text.substr(first, text.find_last_not_of(" \t\r") - first + 1);
}

StatusOr<double> ParseNumber(const std::string& text, const char* what) {
  double value = 0;
  const Status status = ParseOptionText(text, &value);
  if (status.ok()) return value;
  return absl::InvalidArgumentError(Concat(what, " '", text, "': ", status.message()));
}

StatusOr<uint64_t> ParseSession(const std::string& text) {
  char* end = nullptr;
  const uint64_t value = std::strtoull(text.c_str(), &end, 16);
  const bool is_hex = !text.empty() && text.size() <= 16 && *end == '\0' &&
                      std::isxdigit(static_cast<unsigned char>(text[0])) != 0;
  if (is_hex && value != 0) return value;
  return absl::InvalidArgumentError(
      Concat("session '", text, "' is not a number of up to 16 hexadecimal digits"));
}

StatusOr<v1::ControlPoint> ParseLine(const std::string& line) {
  const std::vector<std::string> columns = Split(line, ',');
  if (columns.size() != kColumns) {
    return absl::InvalidArgumentError(Concat(
        "expected 7 columns (id,wgs84|grid,x,y,z,sigma_m,observations), not ", columns.size()));
  }
  v1::ControlPoint point;
  point.set_id(Stripped(columns[0]));
  std::vector<double> numbers;
  for (const size_t i : {2, 3, 4, 5}) {
    PORTOLAN_ASSIGN_OR_RETURN(const double number,
                              ParseNumber(Stripped(columns[i]), "coordinate or sigma"));
    numbers.push_back(number);
  }
  const std::string system = Stripped(columns[1]);
  if (system == "wgs84") {
    point.mutable_geodetic()->set_latitude_deg(numbers[0]);
    point.mutable_geodetic()->set_longitude_deg(numbers[1]);
    point.mutable_geodetic()->set_height_m(numbers[2]);
  } else if (system == "grid") {
    point.mutable_grid()->set_x(numbers[0]);
    point.mutable_grid()->set_y(numbers[1]);
    point.mutable_grid()->set_z(numbers[2]);
  } else {
    return absl::InvalidArgumentError(Concat("the system is wgs84 or grid, not '", system, "'"));
  }
  point.set_sigma_m(numbers[3]);
  for (const std::string& word : Split(columns[6], ' ')) {
    if (Stripped(word).empty()) continue;
    PORTOLAN_ASSIGN_OR_RETURN(*point.add_observations(), ParseObservation(Stripped(word)));
  }
  return point;
}

}  // namespace

StatusOr<int64_t> ParseTimeNs(const std::string& text) {
  const Status bad = absl::InvalidArgumentError(
      Concat("time '", text,
             "' is neither seconds with up to 9 decimals nor whole nanoseconds "
             "followed by ns"));
  const bool is_ns = text.size() > 2 && text.ends_with("ns");
  const std::string number = is_ns ? text.substr(0, text.size() - 2) : text;
  const size_t dot = number.find('.');
  const std::string whole = number.substr(0, dot);
  std::string decimals = dot == std::string::npos ? "" : number.substr(dot + 1);
  if (whole.empty() || decimals.size() > 9 || (is_ns && dot != std::string::npos)) return bad;
  if (!is_ns) decimals.resize(9, '0');
  const std::string digits = whole + decimals;
  if (digits.size() > 18 + 1 || digits.find_first_not_of("0123456789") != std::string::npos) {
    return bad;
  }
  int64_t value = 0;
  if (!ParseOptionText(digits, &value).ok()) return bad;
  return value;
}

StatusOr<v1::ControlObservation> ParseObservation(const std::string& text) {
  const std::vector<std::string> parts = Split(text, ':');
  if (parts.size() != 4 && parts.size() != 5) {
    return absl::InvalidArgumentError(
        Concat("observation '", text, "' is not AGENT[/SESSION]:TIME:U:V[:SIGMA]"));
  }
  v1::ControlObservation observation;
  const size_t slash = parts[0].find('/');
  observation.set_agent_id(parts[0].substr(0, slash));
  if (slash != std::string::npos) {
    PORTOLAN_ASSIGN_OR_RETURN(const uint64_t session, ParseSession(parts[0].substr(slash + 1)));
    observation.set_session_id(session);
  }
  PORTOLAN_ASSIGN_OR_RETURN(const int64_t time_ns, ParseTimeNs(parts[1]));
  observation.set_time_ns(time_ns);
  PORTOLAN_ASSIGN_OR_RETURN(const double u, ParseNumber(parts[2], "pixel"));
  PORTOLAN_ASSIGN_OR_RETURN(const double v, ParseNumber(parts[3], "pixel"));
  observation.set_u_px(u);
  observation.set_v_px(v);
  if (parts.size() == 5) {
    PORTOLAN_ASSIGN_OR_RETURN(const double sigma, ParseNumber(parts[4], "sigma"));
    if (!(sigma > 0)) return absl::InvalidArgumentError("an observation's sigma is not positive");
    observation.set_sigma_px(sigma);
  }
  return observation;
}

StatusOr<std::vector<v1::ControlPoint>> ParseControlPoints(std::istream& file) {
  std::vector<v1::ControlPoint> points;
  std::string line;
  for (int number = 1; std::getline(file, line); ++number) {
    const std::string text = Stripped(line.substr(0, line.find('#')));
    if (text.empty()) continue;
    auto point = ParseLine(text);
    if (!point.ok()) {
      return absl::InvalidArgumentError(Concat("line ", number, ": ", point.status().message()));
    }
    points.push_back(*std::move(point));
  }
  return points;
}

}  // namespace portolan
