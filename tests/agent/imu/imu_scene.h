// A body with a camera and an IMU on a smooth path, for the tests of inertial estimation.
#ifndef PORTOLAN_TESTS_AGENT_IMU_IMU_SCENE_H_
#define PORTOLAN_TESTS_AGENT_IMU_IMU_SCENE_H_

#include <vector>

#include "agent/imu/imu_motion_model.h"
#include "tests/synthetic/body_path.h"
#include "tests/synthetic/imu.h"

namespace portolan {

struct ImuSceneOptions {
  double duration_s = 8;
  // Spread of the path's control points about the start, and the time between them. 0: at rest.
  double sway_m = 0.3;
  double turn_rad = 0.25;
  double knot_interval_s = 0.4;
  // Straight ahead besides.
  double speed_m_s = 0;
  synthetic::ImuOptions imu;
  uint64_t seed = 1;
};

// Times count from 0. The world's z axis points up.
struct ImuScene {
  synthetic::BodyPath path;
  std::vector<synthetic::ImuSample> truth;
  std::vector<ImuSample> samples;  // the same for the agent
  ImuCalibration calibration;
  Rigid3 imu_from_camera;

  Rigid3 WorldFromImu(double time_s) const { return path.At(time_s).world_from_body; }
  Rigid3 WorldFromCamera(double time_s) const { return WorldFromImu(time_s) * imu_from_camera; }
  // The true state in a frame given by its pose in the world.
  InertialState StateAt(double time_s, const Rigid3& world_from_frame) const;
};

ImuScene MakeImuScene(const ImuSceneOptions& options);

// Difference of two states as ImuMotionModel's error: b (+) error == a.
Eigen::VectorXd InertialError(const Rigid3& pose_a, const InertialState& a, const Rigid3& pose_b,
                              const InertialState& b);

}  // namespace portolan

#endif  // PORTOLAN_TESTS_AGENT_IMU_IMU_SCENE_H_
