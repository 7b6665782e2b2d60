// Samples of an inertial measurement unit that moves along a path.
#ifndef PORTOLAN_TESTS_SYNTHETIC_IMU_H_
#define PORTOLAN_TESTS_SYNTHETIC_IMU_H_

#include <Eigen/Core>
#include <vector>

#include "common/base/time.h"
#include "tests/synthetic/body_path.h"

namespace portolan::synthetic {

// Continuous-time densities as in EuRoC's sensor.yaml; the defaults are its ADIS16448.
struct ImuOptions {
  double rate_hz = 200;
  double gyroscope_noise_density = 1.6968e-4;   // rad / s / sqrt(Hz)
  double gyroscope_random_walk = 1.9393e-5;     // rad / s^2 / sqrt(Hz)
  double accelerometer_noise_density = 2.0e-3;  // m / s^2 / sqrt(Hz)
  double accelerometer_random_walk = 3.0e-3;    // m / s^3 / sqrt(Hz)
  // Standard deviation of the biases at the start.
  double initial_gyroscope_bias = 0.02;     // rad / s
  double initial_accelerometer_bias = 0.1;  // m / s^2
  uint64_t seed = 1;
};

struct ImuSample {
  Duration time_since_start{};
  Eigen::Vector3d angular_velocity_rad_s = Eigen::Vector3d::Zero();
  // Specific force: acceleration minus gravity, in the body frame.
  Eigen::Vector3d specific_force_m_s2 = Eigen::Vector3d::Zero();
  // The truth, for the ground-truth file.
  Eigen::Vector3d gyroscope_bias = Eigen::Vector3d::Zero();
  Eigen::Vector3d accelerometer_bias = Eigen::Vector3d::Zero();
};

inline const Eigen::Vector3d kGravityInWorld(0, 0, -9.81);

// From the path's start to its end, both included.
std::vector<ImuSample> SimulateImu(const BodyPath& path, const ImuOptions& options);

}  // namespace portolan::synthetic

#endif  // PORTOLAN_TESTS_SYNTHETIC_IMU_H_
