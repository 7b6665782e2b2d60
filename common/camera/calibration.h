// Camera and IMU calibration files. The format is told by the content:
//  - EuRoC/ASL sensor.yaml;
//  - the plain calib.yaml: width, height, intrinsics, distortion_model none|radtan|equidistant,
//    distortion_coeffs, and optionally rate_hz and T_BS;
//  - OpenCV / ROS camera_info YAML: camera_matrix, distortion_coefficients, image_width, ...;
//  - Kalibr camchain YAML: cam0, cam1, ...
#ifndef PORTOLAN_COMMON_CAMERA_CALIBRATION_H_
#define PORTOLAN_COMMON_CAMERA_CALIBRATION_H_

#include <filesystem>
#include <optional>
#include <vector>

#include "common/base/status.h"
#include "common/base/time.h"
#include "common/camera/camera_model.h"
#include "common/geometry/rigid3.h"

namespace portolan {

struct CameraCalibration {
  // width_px and height_px are 0 where the format does not state them (KITTI).
  CameraIntrinsics intrinsics;
  // Extrinsics towards the IMU or vehicle, where the file gives them; metres.
  std::optional<Rigid3> body_from_camera;
  // Nominal; no value if unknown or not constant.
  std::optional<double> rate_hz;
  // The IMU's clock reads `time_offset` more than the camera's at the same instant
  // (Kalibr: t_imu = t_cam + timeshift_cam_imu; read in the YAML formats with that key).
  std::optional<Duration> time_offset;
};

// Continuous-time noise of an IMU (EuRoC imu0/sensor.yaml, Kalibr imu.yaml).
struct ImuCalibration {
  double rate_hz = 0;
  double gyroscope_noise_density = 0;      // rad / s / sqrt(Hz)
  double gyroscope_random_walk = 0;        // rad / s^2 / sqrt(Hz)
  double accelerometer_noise_density = 0;  // m / s^2 / sqrt(Hz)
  double accelerometer_random_walk = 0;    // m / s^3 / sqrt(Hz)
  Rigid3 body_from_imu;                    // identity where the file is silent
};

// All cameras of a file in order; formats other than Kalibr's hold one. Every camera is checked by
// CameraModel::Create. Errors name the file and the key: NotFound, InvalidArgument (malformed or
// implausible), Unimplemented (a camera model that is not ours).
StatusOr<std::vector<CameraCalibration>> ReadCameraCalibrations(const std::filesystem::path& path);
// One of them; InvalidArgument if the file has no camera of that number.
StatusOr<CameraCalibration> ReadCameraCalibration(const std::filesystem::path& path,
                                                  int camera = 0);

// The rectified camera `camera` (0..3) of a KITTI odometry calib.txt. Sizes are 0: the format does
// not state them. body_from_camera is the position in the frame of camera 0.
StatusOr<CameraCalibration> ReadKittiCalibration(const std::filesystem::path& path, int camera);

StatusOr<ImuCalibration> ReadImuCalibration(const std::filesystem::path& path);

// EuRoC files that the readers above read back (rotations to rounding).
Status WriteEurocSensorYaml(const CameraCalibration& calibration,
                            const std::filesystem::path& path);
Status WriteEurocImuYaml(const ImuCalibration& calibration, const std::filesystem::path& path);

}  // namespace portolan

#endif  // PORTOLAN_COMMON_CAMERA_CALIBRATION_H_
