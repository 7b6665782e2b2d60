#include "agent/image_source/sample_files.h"

#include <algorithm>
#include <string>

#include "agent/image_source/text_lines.h"
#include "common/base/concat.h"
#include "common/base/logging.h"
#include "common/config/yaml_file.h"

namespace portolan {
namespace {

// No vehicle turns or accelerates like this; such a number is a broken line.
constexpr double kMaxGyroRadS = 200;
constexpr double kMaxAccelMS2 = 4000;
constexpr double kMaxPositionM = 1e7;
constexpr double kMaxRangeM = 1e5;
constexpr double kMaxLeverArmM = 100;
// As proto/submap.proto has it.
constexpr double kMinGnssSigmaM = 0.001;
constexpr double kMaxGnssSigmaM = 1e4;

// The numbers of fields first .. first + size - 1, each of at most `limit`.
StatusOr<std::vector<double>> ParseNumbers(const std::vector<std::string>& fields, size_t first,
                                           size_t size, double limit) {
  std::vector<double> numbers(size);
  for (size_t i = 0; i < size; ++i) {
    PORTOLAN_ASSIGN_OR_RETURN(numbers[i], ParseNumber(fields[first + i]));
    if (std::abs(numbers[i]) > limit) {
      return absl::InvalidArgumentError(
          Concat("field ", first + i + 1, " is ", numbers[i], ", beyond ", limit));
    }
  }
  return numbers;
}

StatusOr<ImuSample> ParseImu(const std::vector<std::string>& fields) {
  if (fields.size() < 7) {
    return absl::InvalidArgumentError(Concat("expected 7 fields, got ", fields.size()));
  }
  ImuSample sample;
  PORTOLAN_ASSIGN_OR_RETURN(sample.time, ParseNanoseconds(fields[0]));
  PORTOLAN_ASSIGN_OR_RETURN(const auto gyro, ParseNumbers(fields, 1, 3, kMaxGyroRadS));
  PORTOLAN_ASSIGN_OR_RETURN(const auto accel, ParseNumbers(fields, 4, 3, kMaxAccelMS2));
  sample.gyro_rad_s << gyro[0], gyro[1], gyro[2];
  sample.accel_m_s2 << accel[0], accel[1], accel[2];
  return sample;
}

StatusOr<OdometrySample> ParseOdometry(const std::vector<std::string>& fields) {
  if (fields.size() != 4 && fields.size() != 8) {
    return absl::InvalidArgumentError(
        Concat("expected 4 fields (planar) or 8, got ", fields.size()));
  }
  OdometrySample sample;
  PORTOLAN_ASSIGN_OR_RETURN(sample.time, ParseNanoseconds(fields[0]));
  PORTOLAN_ASSIGN_OR_RETURN(const auto numbers,
                            ParseNumbers(fields, 1, fields.size() - 1, kMaxPositionM));
  if (fields.size() == 4) {
    sample.odometry_from_body.translation << numbers[0], numbers[1], 0;
    sample.odometry_from_body.rotation = RotationExp({0, 0, numbers[2]});
    return sample;
  }
  sample.odometry_from_body.translation << numbers[0], numbers[1], numbers[2];
  const Eigen::Quaterniond q(numbers[3], numbers[4], numbers[5], numbers[6]);
  if (std::abs(q.norm() - 1) > 1e-2) {
    return absl::InvalidArgumentError(Concat("quaternion of length ", q.norm()));
  }
  sample.odometry_from_body.rotation = q.normalized();
  return sample;
}

StatusOr<GnssFix> ParseGnss(const std::vector<std::string>& fields) {
  if (fields.size() != 6) {
    return absl::InvalidArgumentError(Concat("expected 6 fields, got ", fields.size()));
  }
  GnssFix fix;
  PORTOLAN_ASSIGN_OR_RETURN(fix.time, ParseNanoseconds(fields[0]));
  PORTOLAN_ASSIGN_OR_RETURN(const auto numbers, ParseNumbers(fields, 1, 5, kMaxPositionM));
  fix.position = {numbers[0], numbers[1], numbers[2]};
  PORTOLAN_RETURN_IF_ERROR(ValidateGeodetic(fix.position));
  fix.sigma_horizontal_m = numbers[3];
  fix.sigma_vertical_m = numbers[4];
  for (const double sigma : {numbers[3], numbers[4]}) {
    if (!(sigma >= kMinGnssSigmaM && sigma <= kMaxGnssSigmaM)) {
      return absl::InvalidArgumentError(Concat("a standard deviation of ", sigma, " m is not in ",
                                               kMinGnssSigmaM, "..", kMaxGnssSigmaM));
    }
  }
  return fix;
}

StatusOr<RangeSample> ParseRange(const std::vector<std::string>& fields) {
  if (fields.size() != 2 && fields.size() != 3) {
    return absl::InvalidArgumentError(Concat("expected 2 or 3 fields, got ", fields.size()));
  }
  RangeSample sample;
  PORTOLAN_ASSIGN_OR_RETURN(sample.time, ParseNanoseconds(fields[0]));
  PORTOLAN_ASSIGN_OR_RETURN(const auto numbers,
                            ParseNumbers(fields, 1, fields.size() - 1, kMaxRangeM));
  sample.range_m = numbers[0];
  if (numbers.size() == 1) return sample;
  sample.sigma_m = numbers[1];
  if (!(sample.sigma_m > 0)) {
    return absl::InvalidArgumentError(Concat("a standard deviation of ", sample.sigma_m, " m"));
  }
  return sample;
}

StatusOr<Eigen::Vector3d> ReadVector(const YamlFile& file, const std::string& key) {
  PORTOLAN_ASSIGN_OR_RETURN(const std::vector<double> numbers, file.Numbers(file.root(), key));
  if (numbers.size() != 3) {
    return file.Error(file.root()[key], Concat(key, ": expected 3 numbers, got ", numbers.size()));
  }
  return Eigen::Vector3d(numbers[0], numbers[1], numbers[2]);
}

template <typename Sample>
StatusOr<std::vector<Sample>> ReadSamples(
    const std::filesystem::path& path,
    StatusOr<Sample> (*parse)(const std::vector<std::string>& fields)) {
  std::vector<Sample> samples;
  PORTOLAN_RETURN_IF_ERROR(ForEachLine(path, [&](const std::vector<std::string>& fields) -> Status {
    PORTOLAN_ASSIGN_OR_RETURN(Sample sample, parse(fields));
    samples.push_back(std::move(sample));
    return absl::OkStatus();
  }));
  const auto earlier = [](const Sample& a, const Sample& b) { return a.time < b.time; };
  if (!std::is_sorted(samples.begin(), samples.end(), earlier)) {
    LogWarning(path, ": samples are not in order of time; sorted");
    std::stable_sort(samples.begin(), samples.end(), earlier);
  }
  const auto same = [](const Sample& a, const Sample& b) { return a.time == b.time; };
  const auto end = std::unique(samples.begin(), samples.end(), same);
  if (end != samples.end()) {
    LogWarning(path, ": ", samples.end() - end, " samples repeat a time; left out");
    samples.erase(end, samples.end());
  }
  return samples;
}

}  // namespace

StatusOr<std::vector<ImuSample>> ReadImuCsv(const std::filesystem::path& path) {
  return ReadSamples<ImuSample>(path, ParseImu);
}

StatusOr<std::vector<OdometrySample>> ReadOdometryCsv(const std::filesystem::path& path) {
  return ReadSamples<OdometrySample>(path, ParseOdometry);
}

StatusOr<std::vector<GnssFix>> ReadGnssCsv(const std::filesystem::path& path) {
  return ReadSamples<GnssFix>(path, ParseGnss);
}

StatusOr<std::vector<RangeSample>> ReadRangeCsv(const std::filesystem::path& path) {
  return ReadSamples<RangeSample>(path, ParseRange);
}

StatusOr<RangeFinder> ReadRangeFinder(const std::filesystem::path& path) {
  PORTOLAN_ASSIGN_OR_RETURN(const YamlFile file, YamlFile::Load(path));
  const YAML::Node& root = file.root();
  RangeFinder finder;
  PORTOLAN_ASSIGN_OR_RETURN(finder.position_in_camera_m, ReadVector(file, "position_in_camera_m"));
  if (finder.position_in_camera_m.norm() > kMaxLeverArmM) {
    return file.Error(root["position_in_camera_m"],
                      Concat("position_in_camera_m: more than ", kMaxLeverArmM, " m"));
  }
  PORTOLAN_ASSIGN_OR_RETURN(const auto direction, ReadVector(file, "direction_in_camera"));
  if (!(direction.norm() > 1e-6)) {
    return file.Error(root["direction_in_camera"], "direction_in_camera: has no length");
  }
  finder.direction_in_camera = direction.normalized();
  for (const auto& [key, value] :
       {std::pair("sigma_m", &finder.sigma_m), std::pair("min_range_m", &finder.min_range_m),
        std::pair("max_range_m", &finder.max_range_m)}) {
    PORTOLAN_ASSIGN_OR_RETURN(*value, file.Number(root, key));
    if (!(*value > 0 && *value <= kMaxRangeM)) {
      return file.Error(root[key], Concat(key, ": must be within 0 and ", kMaxRangeM));
    }
  }
  if (!(finder.min_range_m < finder.max_range_m)) {
    return file.Error(root["max_range_m"], "max_range_m: must be more than min_range_m");
  }
  return finder;
}

}  // namespace portolan
