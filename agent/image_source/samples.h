// What an agent's sensors other than cameras deliver.
#ifndef PORTOLAN_AGENT_IMAGE_SOURCE_SAMPLES_H_
#define PORTOLAN_AGENT_IMAGE_SOURCE_SAMPLES_H_

#include <Eigen/Core>

#include "common/base/time.h"
#include "common/geometry/rigid3.h"

namespace portolan {

// In the IMU's frame; acceleration is the specific force (at rest: 9.81 upwards).
struct ImuSample {
  Timestamp time{};
  Eigen::Vector3d gyro_rad_s = Eigen::Vector3d::Zero();
  Eigen::Vector3d accel_m_s2 = Eigen::Vector3d::Zero();
};

// Pose of the body by wheel odometry in a frame of its own that drifts: only the increment between
// two samples means anything. Metres.
struct OdometrySample {
  Timestamp time{};
  Rigid3 odometry_from_body;
};

// A laser range finder fixed to the camera, which measures along one ray. Camera frame, metres.
struct RangeFinder {
  Eigen::Vector3d position_in_camera_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d direction_in_camera = Eigen::Vector3d::UnitZ();  // of length 1
  // Of a range whose sample does not say.
  double sigma_m = 0.01;
  // What it can measure; all else is no echo.
  double min_range_m = 0.05;
  double max_range_m = 100;
};

// From the range finder's position to the surface that its ray hits.
struct RangeSample {
  Timestamp time{};
  double range_m = 0;
  double sigma_m = 0;  // 0: the sensor's
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_IMAGE_SOURCE_SAMPLES_H_
