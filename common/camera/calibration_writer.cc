#include <fstream>
#include <sstream>

#include "common/base/concat.h"
#include "common/camera/calibration.h"

namespace portolan {
namespace {

std::string RigidYaml(const Rigid3& rigid) {
  std::ostringstream out;
  out.precision(17);
  out << "T_BS:\n  cols: 4\n  rows: 4\n  data: [";
  const Eigen::Matrix4d matrix = rigid.Matrix();
  for (int row = 0; row < 4; ++row) {
    for (int column = 0; column < 4; ++column) {
      out << matrix(row, column) << (row == 3 && column == 3 ? "]\n" : ", ");
    }
    if (row < 3) out << "\n         ";
  }
  return out.str();
}

Status WriteText(const std::string& text, const std::filesystem::path& path) {
  std::ofstream file(path, std::ios::binary | std::ios::trunc);
  file << text;
  file.close();
  if (!file) return absl::UnavailableError(Concat(path, ": cannot be written"));
  return absl::OkStatus();
}

}  // namespace

Status WriteEurocSensorYaml(const CameraCalibration& calibration,
                            const std::filesystem::path& path) {
  const CameraIntrinsics& intrinsics = calibration.intrinsics;
  std::ostringstream out;
  out.precision(17);
  out << "# camera calibration, EuRoC/ASL format\nsensor_type: camera\n";
  if (calibration.body_from_camera) out << RigidYaml(*calibration.body_from_camera);
  if (calibration.rate_hz) out << "rate_hz: " << *calibration.rate_hz << "\n";
  if (calibration.time_offset) {
    out << "timeshift_cam_imu: " << ToSeconds(*calibration.time_offset)
        << "  # t_imu = t_cam + this [s]\n";
  }
  out << "resolution: [" << intrinsics.width_px << ", " << intrinsics.height_px << "]\n"
      << "camera_model: pinhole\n"
      << "intrinsics: [" << intrinsics.fx_px << ", " << intrinsics.fy_px << ", " << intrinsics.cx_px
      << ", " << intrinsics.cy_px << "]  # fx fy cx cy [px]\n";
  const auto& k = intrinsics.coefficients;
  switch (intrinsics.distortion) {
    case DistortionModel::kNone:
      out << "distortion_model: none\ndistortion_coefficients: []\n";
      break;
    case DistortionModel::kRadTan:
      out << "distortion_model: radial-tangential  # k1 k2 p1 p2 k3\n"
          << "distortion_coefficients: [" << k[0] << ", " << k[1] << ", " << k[2] << ", " << k[3];
      if (k[4] != 0) out << ", " << k[4];  // EuRoC's own files end after p2
      out << "]\n";
      break;
    case DistortionModel::kEquidistant:
      out << "distortion_model: equidistant  # k1 k2 k3 k4\n"
          << "distortion_coefficients: [" << k[0] << ", " << k[1] << ", " << k[2] << ", " << k[3]
          << "]\n";
      break;
  }
  return WriteText(out.str(), path);
}

Status WriteEurocImuYaml(const ImuCalibration& calibration, const std::filesystem::path& path) {
  std::ostringstream out;
  out.precision(17);
  out << "# IMU calibration, EuRoC/ASL format\nsensor_type: imu\n"
      << RigidYaml(calibration.body_from_imu) << "rate_hz: " << calibration.rate_hz << "\n"
      << "gyroscope_noise_density: " << calibration.gyroscope_noise_density
      << "  # rad / s / sqrt(Hz)\n"
      << "gyroscope_random_walk: " << calibration.gyroscope_random_walk
      << "  # rad / s^2 / sqrt(Hz)\n"
      << "accelerometer_noise_density: " << calibration.accelerometer_noise_density
      << "  # m / s^2 / sqrt(Hz)\n"
      << "accelerometer_random_walk: " << calibration.accelerometer_random_walk
      << "  # m / s^3 / sqrt(Hz)\n";
  return WriteText(out.str(), path);
}

}  // namespace portolan
