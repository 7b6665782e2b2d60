#include "common/trajectory/trajectory_io.h"

#include <array>
#include <cmath>
#include <cstdlib>
#include <fstream>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"

namespace portolan {
namespace {

// Largest deviation from a rotation (norm or orthogonality) taken for rounding.
constexpr double kRotationTolerance = 1e-2;
constexpr double kLargestSeconds = 9e9;

// Reads lines that hold data, splits them, and names the place in errors.
class LineReader {
 public:
  LineReader(std::istream& input, std::string name, bool comma_separated)
      : input_(input), name_(std::move(name)), comma_separated_(comma_separated) {}

  // False at the end of the input.
  bool Next() {
    std::string line;
    while (std::getline(input_, line)) {
      ++line_number_;
      const absl::string_view text = absl::StripAsciiWhitespace(line);
      if (text.empty() || text.front() == '#') continue;
      fields_ = comma_separated_ ? std::vector<std::string>(absl::StrSplit(text, ','))
                                 : std::vector<std::string>(absl::StrSplit(
                                       text, absl::ByAnyChar(" \t"), absl::SkipEmpty()));
      for (std::string& field : fields_) absl::StripAsciiWhitespace(&field);
      return true;
    }
    return false;
  }

  const std::vector<std::string>& fields() const { return fields_; }

  Status Error(absl::string_view message) const {
    return absl::InvalidArgumentError(absl::StrCat(name_, ":", line_number_, ": ", message));
  }

  // Parses fields [begin, begin + size) as finite numbers.
  template <size_t size>
  StatusOr<std::array<double, size>> Numbers(size_t begin) const {
    std::array<double, size> numbers;
    for (size_t i = 0; i < size; ++i) {
      const std::string& field = fields_[begin + i];
      if (!absl::SimpleAtod(field, &numbers[i]) || !std::isfinite(numbers[i])) {
        return Error(
            absl::StrCat("field ", begin + i + 1, " is not a finite number: '", field, "'"));
      }
    }
    return numbers;
  }

  Status CheckFieldCount(size_t least, size_t most) const {
    if (fields_.size() >= least && fields_.size() <= most) return absl::OkStatus();
    return Error(absl::StrCat("expected ", least, " fields, found ", fields_.size()));
  }

 private:
  std::istream& input_;
  std::string name_;
  bool comma_separated_;
  int line_number_ = 0;
  std::vector<std::string> fields_;
};

StatusOr<Eigen::Quaterniond> CheckedRotation(const LineReader& reader, double w, double x, double y,
                                             double z) {
  const Eigen::Quaterniond rotation(w, x, y, z);
  if (std::abs(rotation.norm() - 1.0) > kRotationTolerance) {
    return reader.Error(absl::StrCat("quaternion has norm ", rotation.norm(), ", not 1"));
  }
  return rotation.normalized();
}

StatusOr<Rigid3> PoseFromMatrixRow(const LineReader& reader, const std::array<double, 12>& row) {
  using RowMatrix34d = Eigen::Matrix<double, 3, 4, Eigen::RowMajor>;
  const Eigen::Map<const RowMatrix34d> matrix(row.data());
  const Eigen::Matrix3d rotation = matrix.leftCols<3>();
  const double deviation =
      (rotation * rotation.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  if (!(deviation < kRotationTolerance) || rotation.determinant() < 0) {
    return reader.Error("the left 3x3 block is not a rotation");
  }
  return Rigid3{Eigen::Quaterniond(rotation).normalized(), matrix.col(3)};
}

Status AppendPose(const LineReader& reader, Timestamp time, const Rigid3& pose,
                  Trajectory* trajectory) {
  if (!trajectory->empty() && time <= trajectory->back().time) {
    return reader.Error("time does not ascend");
  }
  trajectory->push_back({time, pose});
  return absl::OkStatus();
}

StatusOr<std::ifstream> OpenInput(const std::string& path) {
  std::ifstream input(path);
  if (!input) return absl::NotFoundError(absl::StrCat(path, ": cannot be opened for reading"));
  return input;
}

template <typename Format>
Status WriteFile(const std::string& path, const Format& format) {
  std::ofstream output(path);
  if (!output) return absl::PermissionDeniedError(absl::StrCat(path, ": cannot be written"));
  format(output);
  output.flush();
  if (!output) return absl::DataLossError(absl::StrCat(path, ": write failed"));
  return absl::OkStatus();
}

// Digits of the fraction as nanoseconds, rounded at the tenth digit.
int64_t FractionToNanoseconds(absl::string_view digits) {
  int64_t nanoseconds = 0;
  for (size_t i = 0; i < 9; ++i) {
    nanoseconds = nanoseconds * 10 + (i < digits.size() ? digits[i] - '0' : 0);
  }
  return nanoseconds + (digits.size() > 9 && digits[9] >= '5' ? 1 : 0);
}

bool AllDigits(absl::string_view text) {
  for (const char c : text) {
    if (!absl::ascii_isdigit(static_cast<unsigned char>(c))) return false;
  }
  return true;
}

}  // namespace

std::string FormatSeconds(Timestamp time) {
  const int64_t count = time.count();
  const uint64_t magnitude =
      count < 0 ? uint64_t{0} - static_cast<uint64_t>(count) : static_cast<uint64_t>(count);
  return absl::StrFormat("%s%d.%09d", count < 0 ? "-" : "", magnitude / 1000000000u,
                         magnitude % 1000000000u);
}

StatusOr<Timestamp> ParseSeconds(const std::string& text) {
  double value = 0;
  if (text.find_first_not_of("0123456789+-.eE") != std::string::npos ||
      !absl::SimpleAtod(text, &value) || !std::isfinite(value) ||
      std::abs(value) > kLargestSeconds) {
    return absl::InvalidArgumentError(absl::StrCat("not a time in seconds: '", text, "'"));
  }
  // A double holds 1.4e9 s only to 0.2 us, so plain decimals are read digit by digit.
  absl::string_view digits = text;
  const bool negative = absl::ConsumePrefix(&digits, "-");
  if (!negative) absl::ConsumePrefix(&digits, "+");
  const std::pair<absl::string_view, absl::string_view> parts =
      absl::StrSplit(digits, absl::MaxSplits('.', 1));
  int64_t seconds = 0;
  if (!AllDigits(parts.first) || !AllDigits(parts.second) ||
      !absl::SimpleAtoi(parts.first, &seconds)) {
    return FromSeconds(value);
  }
  const int64_t nanoseconds = seconds * 1000000000 + FractionToNanoseconds(parts.second);
  return Timestamp(negative ? -nanoseconds : nanoseconds);
}

StatusOr<Trajectory> ParseTumTrajectory(std::istream& input, const std::string& name) {
  LineReader reader(input, name, /*comma_separated=*/false);
  Trajectory trajectory;
  while (reader.Next()) {
    PORTOLAN_RETURN_IF_ERROR(reader.CheckFieldCount(8, 8));
    const StatusOr<Timestamp> time = ParseSeconds(reader.fields()[0]);
    if (!time.ok()) return reader.Error(time.status().message());
    PORTOLAN_ASSIGN_OR_RETURN(const auto numbers, reader.Numbers<7>(1));
    PORTOLAN_ASSIGN_OR_RETURN(
        const Eigen::Quaterniond rotation,
        CheckedRotation(reader, numbers[6], numbers[3], numbers[4], numbers[5]));
    PORTOLAN_RETURN_IF_ERROR(
        AppendPose(reader, *time, {rotation, {numbers[0], numbers[1], numbers[2]}}, &trajectory));
  }
  return trajectory;
}

StatusOr<Trajectory> ParseEurocGroundTruth(std::istream& input, const std::string& name) {
  LineReader reader(input, name, /*comma_separated=*/true);
  Trajectory trajectory;
  while (reader.Next()) {
    // Time and pose; velocity and biases (9 more) may follow.
    PORTOLAN_RETURN_IF_ERROR(reader.CheckFieldCount(8, 17));
    int64_t nanoseconds = 0;
    if (!absl::SimpleAtoi(reader.fields()[0], &nanoseconds)) {
      return reader.Error(absl::StrCat("not a time in nanoseconds: '", reader.fields()[0], "'"));
    }
    PORTOLAN_ASSIGN_OR_RETURN(const auto numbers, reader.Numbers<7>(1));
    PORTOLAN_ASSIGN_OR_RETURN(
        const Eigen::Quaterniond rotation,
        CheckedRotation(reader, numbers[3], numbers[4], numbers[5], numbers[6]));
    PORTOLAN_RETURN_IF_ERROR(AppendPose(reader, Timestamp(nanoseconds),
                                        {rotation, {numbers[0], numbers[1], numbers[2]}},
                                        &trajectory));
  }
  return trajectory;
}

StatusOr<Trajectory> ParseKittiTrajectory(std::istream& poses, const std::string& poses_name,
                                          const std::vector<Timestamp>& times) {
  LineReader reader(poses, poses_name, /*comma_separated=*/false);
  Trajectory trajectory;
  while (reader.Next()) {
    PORTOLAN_RETURN_IF_ERROR(reader.CheckFieldCount(12, 12));
    if (trajectory.size() == times.size()) {
      return reader.Error(absl::StrCat("more poses than times (", times.size(), ")"));
    }
    PORTOLAN_ASSIGN_OR_RETURN(const auto numbers, reader.Numbers<12>(0));
    PORTOLAN_ASSIGN_OR_RETURN(const Rigid3 pose, PoseFromMatrixRow(reader, numbers));
    PORTOLAN_RETURN_IF_ERROR(AppendPose(reader, times[trajectory.size()], pose, &trajectory));
  }
  if (trajectory.size() != times.size()) {
    return reader.Error(
        absl::StrCat("fewer poses (", trajectory.size(), ") than times (", times.size(), ")"));
  }
  return trajectory;
}

StatusOr<std::vector<Timestamp>> ParseTimes(std::istream& input, const std::string& name) {
  LineReader reader(input, name, /*comma_separated=*/false);
  std::vector<Timestamp> times;
  while (reader.Next()) {
    const StatusOr<Timestamp> time = ParseSeconds(reader.fields()[0]);
    if (!time.ok()) return reader.Error(time.status().message());
    if (!times.empty() && *time <= times.back()) return reader.Error("time does not ascend");
    times.push_back(*time);
  }
  return times;
}

StatusOr<Trajectory> ReadTumTrajectory(const std::string& path) {
  PORTOLAN_ASSIGN_OR_RETURN(std::ifstream input, OpenInput(path));
  return ParseTumTrajectory(input, path);
}

StatusOr<Trajectory> ReadKittiTrajectory(const std::string& poses_path,
                                         const std::string& times_path) {
  PORTOLAN_ASSIGN_OR_RETURN(const std::vector<Timestamp> times, ReadTimes(times_path));
  PORTOLAN_ASSIGN_OR_RETURN(std::ifstream input, OpenInput(poses_path));
  return ParseKittiTrajectory(input, poses_path, times);
}

StatusOr<Trajectory> ReadEurocGroundTruth(const std::string& path) {
  PORTOLAN_ASSIGN_OR_RETURN(std::ifstream input, OpenInput(path));
  return ParseEurocGroundTruth(input, path);
}

StatusOr<Trajectory> ReadTrajectory(const std::string& path) {
  PORTOLAN_ASSIGN_OR_RETURN(std::ifstream input, OpenInput(path));
  LineReader reader(input, path, /*comma_separated=*/true);
  const bool is_euroc = reader.Next() && reader.fields().size() > 1;
  return is_euroc ? ReadEurocGroundTruth(path) : ReadTumTrajectory(path);
}

StatusOr<std::vector<Timestamp>> ReadTimes(const std::string& path) {
  PORTOLAN_ASSIGN_OR_RETURN(std::ifstream input, OpenInput(path));
  return ParseTimes(input, path);
}

void FormatTumTrajectory(const Trajectory& trajectory, std::ostream& output) {
  output << "# timestamp tx ty tz qx qy qz qw\n";
  for (const StampedPose& pose : trajectory) {
    const Eigen::Vector3d& t = pose.world_from_body.translation;
    const Eigen::Quaterniond& q = pose.world_from_body.rotation;
    output << FormatSeconds(pose.time)
           << absl::StrFormat(" %.9f %.9f %.9f %.9f %.9f %.9f %.9f\n", t.x(), t.y(), t.z(), q.x(),
                              q.y(), q.z(), q.w());
  }
}

void FormatKittiTrajectory(const Trajectory& trajectory, std::ostream& output) {
  for (const StampedPose& pose : trajectory) {
    const Eigen::Matrix4d matrix = pose.world_from_body.Matrix();
    for (int i = 0; i < 12; ++i) {
      output << absl::StrFormat("%s%.9e", i == 0 ? "" : " ", matrix(i / 4, i % 4));
    }
    output << '\n';
  }
}

Status WriteTumTrajectory(const Trajectory& trajectory, const std::string& path) {
  return WriteFile(path, [&](std::ostream& out) { FormatTumTrajectory(trajectory, out); });
}

Status WriteKittiTrajectory(const Trajectory& trajectory, const std::string& poses_path,
                            const std::string& times_path) {
  PORTOLAN_RETURN_IF_ERROR(
      WriteFile(poses_path, [&](std::ostream& out) { FormatKittiTrajectory(trajectory, out); }));
  return WriteFile(times_path, [&](std::ostream& out) {
    for (const StampedPose& pose : trajectory) out << FormatSeconds(pose.time) << '\n';
  });
}

}  // namespace portolan
