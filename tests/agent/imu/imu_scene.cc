#include "tests/agent/imu/imu_scene.h"

#include <cmath>

#include "tests/synthetic/random.h"

namespace portolan {

InertialState ImuScene::StateAt(double time_s, const Rigid3& world_from_frame) const {
  const Eigen::Quaterniond frame_from_world = world_from_frame.rotation.conjugate();
  const auto index = static_cast<size_t>(std::lround(time_s * calibration.rate_hz));
  InertialState state;
  state.velocity = frame_from_world * path.At(time_s).velocity_in_world;
  state.gyro_bias = truth.at(index).gyroscope_bias;
  state.accel_bias = truth.at(index).accelerometer_bias;
  state.gravity_frame = FrameAlong(frame_from_world * Eigen::Vector3d(0, 0, -1));
  return state;
}

ImuScene MakeImuScene(const ImuSceneOptions& options) {
  synthetic::Random random(1000 + options.seed);
  std::vector<synthetic::PathKnot> knots;
  const int count = static_cast<int>(options.duration_s / options.knot_interval_s) + 4;
  for (int i = 0; i < count; ++i) {
    synthetic::PathKnot knot;
    knot.position_m = options.sway_m * random.Normal3();
    knot.position_m.x() += options.speed_m_s * options.knot_interval_s * i;
    knot.yaw_pitch_roll_rad = options.turn_rad * random.Normal3();
    knots.push_back(knot);
  }
  ImuScene scene{synthetic::BodyPath(knots, options.knot_interval_s), {}, {}, {}, {}};
  synthetic::ImuOptions imu = options.imu;
  imu.seed = options.seed;
  scene.truth = synthetic::SimulateImu(scene.path, imu);
  for (const synthetic::ImuSample& sample : scene.truth) {
    scene.samples.push_back(
        {sample.time_since_start, sample.angular_velocity_rad_s, sample.specific_force_m_s2});
  }
  scene.calibration.rate_hz = imu.rate_hz;
  scene.calibration.gyroscope_noise_density = imu.gyroscope_noise_density;
  scene.calibration.gyroscope_random_walk = imu.gyroscope_random_walk;
  scene.calibration.accelerometer_noise_density = imu.accelerometer_noise_density;
  scene.calibration.accelerometer_random_walk = imu.accelerometer_random_walk;
  // Looks along the body's x axis, its x axis to the right; a lever arm as on a small vehicle.
  Eigen::Matrix3d rotation;
  rotation << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  scene.imu_from_camera = {Eigen::Quaterniond(rotation), {0.07, -0.03, 0.02}};
  return scene;
}

Eigen::VectorXd InertialError(const Rigid3& pose_a, const InertialState& a, const Rigid3& pose_b,
                              const InertialState& b) {
  Eigen::VectorXd error(ImuMotionModel::kDim);
  error << pose_a.translation - pose_b.translation,
      RotationLog(pose_b.rotation.conjugate() * pose_a.rotation), a.velocity - b.velocity,
      a.gyro_bias - b.gyro_bias, a.accel_bias - b.accel_bias,
      b.gravity_frame.leftCols<2>().transpose() * a.gravity_direction();
  return error;
}

}  // namespace portolan
