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

}  // namespace portolan

#endif  // PORTOLAN_AGENT_IMAGE_SOURCE_SAMPLES_H_
