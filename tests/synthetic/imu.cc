#include "tests/synthetic/imu.h"

#include <cmath>

#include "tests/synthetic/random.h"

namespace portolan::synthetic {

std::vector<ImuSample> SimulateImu(const BodyPath& path, const ImuOptions& options) {
  Random random(options.seed);
  const double step_s = 1.0 / options.rate_hz;
  // Densities to samples: noise by sqrt(rate), random walk by sqrt(step).
  const double gyroscope_sigma = options.gyroscope_noise_density * std::sqrt(options.rate_hz);
  const double accelerometer_sigma =
      options.accelerometer_noise_density * std::sqrt(options.rate_hz);
  const double gyroscope_step = options.gyroscope_random_walk * std::sqrt(step_s);
  const double accelerometer_step = options.accelerometer_random_walk * std::sqrt(step_s);
  Eigen::Vector3d gyroscope_bias = options.initial_gyroscope_bias * random.Normal3();
  Eigen::Vector3d accelerometer_bias = options.initial_accelerometer_bias * random.Normal3();
  std::vector<ImuSample> samples;
  const int count = static_cast<int>(std::floor(path.duration_s() * options.rate_hz + 1e-6)) + 1;
  for (int i = 0; i < count; ++i) {
    const BodyState state = path.At(i * step_s);
    ImuSample sample;
    sample.time_since_start = FromSeconds(i * step_s);
    sample.gyroscope_bias = gyroscope_bias;
    sample.accelerometer_bias = accelerometer_bias;
    sample.angular_velocity_rad_s =
        state.angular_velocity_in_body + gyroscope_bias + gyroscope_sigma * random.Normal3();
    sample.specific_force_m_s2 = state.world_from_body.rotation.conjugate() *
                                     (state.acceleration_in_world - kGravityInWorld) +
                                 accelerometer_bias + accelerometer_sigma * random.Normal3();
    samples.push_back(sample);
    gyroscope_bias += gyroscope_step * random.Normal3();
    accelerometer_bias += accelerometer_step * random.Normal3();
  }
  return samples;
}

}  // namespace portolan::synthetic
