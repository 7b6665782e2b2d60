#include "tests/synthetic/imu.h"

#include <cmath>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/support/matchers.h"
#include "tests/synthetic/mission.h"

namespace portolan::synthetic {
namespace {

BodyPath LoopPath() {
  MissionOptions options;
  options.name = "loop";
  return MakeMission(options)->agents[0].path;
}

// Trapezoidal integration of rates and specific forces from the path's true start.
BodyState Integrate(const BodyPath& path, const std::vector<ImuSample>& samples) {
  BodyState state = path.At(0);
  for (size_t i = 1; i < samples.size(); ++i) {
    const ImuSample &a = samples[i - 1], &b = samples[i];
    const double step_s = ToSeconds(b.time_since_start - a.time_since_start);
    const Eigen::Quaterniond before = state.world_from_body.rotation;
    const Eigen::Vector3d rate = 0.5 * (a.angular_velocity_rad_s - a.gyroscope_bias +
                                        b.angular_velocity_rad_s - b.gyroscope_bias);
    const Eigen::Quaterniond after = before * RotationExp(rate * step_s);
    const Eigen::Vector3d acceleration =
        0.5 * (before * (a.specific_force_m_s2 - a.accelerometer_bias) +
               after * (b.specific_force_m_s2 - b.accelerometer_bias)) +
        kGravityInWorld;
    state.world_from_body.translation +=
        step_s * state.velocity_in_world + 0.5 * step_s * step_s * acceleration;
    state.velocity_in_world += step_s * acceleration;
    state.world_from_body.rotation = after.normalized();
  }
  return state;
}

TEST(SimulateImu, WithoutNoiseIntegratesToTheTruth) {
  const BodyPath path = LoopPath();
  ImuOptions options;
  options.gyroscope_noise_density = options.accelerometer_noise_density = 0;
  const auto samples = SimulateImu(path, options);
  const BodyState end = Integrate(path, samples);
  const BodyState truth = path.At(ToSeconds(samples.back().time_since_start));
  EXPECT_GT((truth.world_from_body.translation - path.At(0).world_from_body.translation).norm(),
            0.5);
  EXPECT_THAT(end.world_from_body, NearRigid(truth.world_from_body, 5e-3));
  EXPECT_THAT(end.velocity_in_world, NearMatrix(truth.velocity_in_world, 2e-3));
}

TEST(SimulateImu, AtRestMeasuresGravityUpwards) {
  const PathKnot knot;
  const BodyPath path({knot, knot, knot, knot, knot}, 1.0);
  ImuOptions options;
  options.initial_accelerometer_bias = options.initial_gyroscope_bias = 0;
  for (const ImuSample& sample : SimulateImu(path, options)) {
    EXPECT_THAT(sample.specific_force_m_s2, NearMatrix(Eigen::Vector3d(0, 0, 9.81), 0.2));
    EXPECT_THAT(sample.angular_velocity_rad_s, NearMatrix(Eigen::Vector3d::Zero(), 0.02));
  }
}

TEST(SimulateImu, NoiseAndWalkHaveTheStatedSize) {
  const PathKnot knot;
  const BodyPath path(std::vector<PathKnot>(103, knot), 1.0);
  ImuOptions options;
  options.seed = 5;
  const auto samples = SimulateImu(path, options);
  ASSERT_EQ(samples.size(), 100u * 200u + 1);
  double noise = 0, walk = 0;
  for (size_t i = 1; i < samples.size(); ++i) {
    noise += (samples[i].angular_velocity_rad_s - samples[i].gyroscope_bias).squaredNorm();
    walk += (samples[i].accelerometer_bias - samples[i - 1].accelerometer_bias).squaredNorm();
  }
  const double count = 3.0 * static_cast<double>(samples.size() - 1);
  EXPECT_NEAR(std::sqrt(noise / count), 1.6968e-4 * std::sqrt(200.0), 5e-5);
  EXPECT_NEAR(std::sqrt(walk / count), 3.0e-3 / std::sqrt(200.0), 5e-6);
}

TEST(SimulateImu, IsDeterministicBySeed) {
  const BodyPath path = LoopPath();
  ImuOptions options;
  const auto first = SimulateImu(path, options), second = SimulateImu(path, options);
  options.seed = 2;
  const auto other = SimulateImu(path, options);
  EXPECT_EQ(first[70].angular_velocity_rad_s, second[70].angular_velocity_rad_s);
  EXPECT_NE(first[70].angular_velocity_rad_s, other[70].angular_velocity_rad_s);
}

}  // namespace
}  // namespace portolan::synthetic
