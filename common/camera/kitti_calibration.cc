#include <fstream>
#include <string>

#include "absl/strings/numbers.h"
#include "absl/strings/str_split.h"
#include "common/base/concat.h"
#include "common/camera/calibration.h"

namespace portolan {
namespace {

// The 12 numbers of a line "P0: ...", row by row.
StatusOr<std::vector<double>> ParseProjection(const std::string& text) {
  std::vector<double> numbers;
  for (const absl::string_view word : absl::StrSplit(text, ' ', absl::SkipWhitespace())) {
    double number;
    if (!absl::SimpleAtod(word, &number) || !std::isfinite(number)) {
      return absl::InvalidArgumentError(
          Concat("entry ", numbers.size(), " is not a finite number"));
    }
    numbers.push_back(number);
  }
  if (numbers.size() != 12) {
    return absl::InvalidArgumentError(Concat("expected 12 numbers, got ", numbers.size()));
  }
  return numbers;
}

}  // namespace

StatusOr<CameraCalibration> ReadKittiCalibration(const std::filesystem::path& path, int camera) {
  std::ifstream file(path);
  if (!file) return absl::NotFoundError(Concat(path, ": cannot be opened"));
  const std::string key = Concat("P", camera, ":");
  std::string line;
  for (int number = 1; std::getline(file, line); ++number) {
    if (line.compare(0, key.size(), key) != 0) continue;
    const StatusOr<std::vector<double>> projection = ParseProjection(line.substr(key.size()));
    if (!projection.ok()) {
      return absl::InvalidArgumentError(
          Concat(path, ":", number, ": ", key, " ", std::string(projection.status().message())));
    }
    const std::vector<double>& p = *projection;
    if (!(p[0] > 0 && p[5] > 0)) {
      return absl::InvalidArgumentError(
          Concat(path, ":", number, ": ", key, " focal length is not positive"));
    }
    CameraCalibration calibration;
    calibration.intrinsics.fx_px = p[0];
    calibration.intrinsics.cx_px = p[2];
    calibration.intrinsics.fy_px = p[5];
    calibration.intrinsics.cy_px = p[6];
    // P = K [I | t], t the position of the frame of camera 0 in this camera.
    const Eigen::Vector3d t((p[3] - p[2] * p[11]) / p[0], (p[7] - p[6] * p[11]) / p[5], p[11]);
    calibration.body_from_camera = Rigid3{Eigen::Quaterniond::Identity(), -t};
    calibration.rate_hz = 10;
    return calibration;
  }
  return absl::InvalidArgumentError(Concat(path, ": key '", key, "' is missing"));
}

}  // namespace portolan
