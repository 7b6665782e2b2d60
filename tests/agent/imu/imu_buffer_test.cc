#include "agent/imu/imu_buffer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <numeric>

namespace portolan {
namespace {

ImuSample SampleAt(double time_s) {
  // Rates that grow linearly with time: interpolation is exact.
  return {FromSeconds(time_s), Eigen::Vector3d(time_s, 0, 0), Eigen::Vector3d(0, 2 * time_s, 0)};
}

std::vector<ImuSample> SamplesUpTo(double end_s) {
  std::vector<ImuSample> samples;
  for (int i = 0; i * 0.01 <= end_s + 1e-9; ++i) samples.push_back(SampleAt(0.01 * i));
  return samples;
}

double Duration_s(const std::vector<ImuStep>& steps) {
  return std::accumulate(steps.begin(), steps.end(), 0.0,
                         [](double sum, const ImuStep& step) { return sum + step.dt_s; });
}

bool AllMeasured(const std::vector<ImuStep>& steps) {
  return std::all_of(steps.begin(), steps.end(), [](const auto& step) { return step.measured; });
}

TEST(ImuBuffer, StepsCoverTheTimeAndInterpolateTheEnds) {
  ImuBuffer buffer({});
  buffer.Add(SamplesUpTo(1));
  const auto steps = buffer.Steps(FromSeconds(0.503), FromSeconds(0.537));
  ASSERT_EQ(steps.size(), 4u);
  EXPECT_NEAR(Duration_s(steps), 0.034, 1e-9);
  EXPECT_NEAR(steps[0].gyro_rad_s.x(), 0.5065, 1e-9);
  EXPECT_NEAR(steps[1].accel_m_s2.y(), 2 * 0.515, 1e-9);
  EXPECT_NEAR(steps[3].gyro_rad_s.x(), 0.5335, 1e-9);
  EXPECT_TRUE(AllMeasured(steps));
}

TEST(ImuBuffer, TheLastSampleIsHeldForAWhileOnly) {
  ImuBuffer buffer({});
  buffer.Add(SamplesUpTo(1));
  const auto held = buffer.Steps(FromSeconds(0.99), FromSeconds(1.02));
  EXPECT_NEAR(Duration_s(held), 0.03, 1e-9);
  EXPECT_TRUE(AllMeasured(held));
  EXPECT_FALSE(AllMeasured(buffer.Steps(FromSeconds(0.99), FromSeconds(1.2))));
}

TEST(ImuBuffer, WithoutSamplesNothingIsMeasured) {
  const ImuBuffer buffer({});
  const auto steps = buffer.Steps(FromSeconds(1), FromSeconds(2));
  ASSERT_EQ(steps.size(), 1u);
  EXPECT_NEAR(steps[0].dt_s, 1, 1e-12);
  EXPECT_FALSE(steps[0].measured);
  EXPECT_TRUE(buffer.Steps(FromSeconds(2), FromSeconds(1)).empty());
}

TEST(ImuBuffer, AGapIsToldFromTheRest) {
  ImuBuffer buffer({});
  std::vector<ImuSample> samples = SamplesUpTo(1);
  samples.erase(samples.begin() + 40, samples.begin() + 60);
  buffer.Add(samples);
  EXPECT_EQ(buffer.counts().gaps, 1);
  const auto steps = buffer.Steps(FromSeconds(0.3), FromSeconds(0.8));
  EXPECT_NEAR(Duration_s(steps), 0.5, 1e-9);
  double unmeasured_s = 0;
  for (const ImuStep& step : steps) unmeasured_s += step.measured ? 0 : step.dt_s;
  EXPECT_NEAR(unmeasured_s, 0.21, 1e-9);
}

TEST(ImuBuffer, DamagedSamplesAreCountedAndLeftOut) {
  ImuBuffer buffer({});
  std::vector<ImuSample> samples = SamplesUpTo(0.2);
  samples[3].gyro_rad_s.y() = std::numeric_limits<double>::quiet_NaN();
  samples[5].accel_m_s2.z() = std::numeric_limits<double>::infinity();
  samples[7].accel_m_s2.z() = 1e5;
  samples[9].time = samples[8].time;
  samples[11].time = samples[2].time;
  buffer.Add(samples);
  EXPECT_EQ(buffer.counts().not_finite, 2);
  EXPECT_EQ(buffer.counts().beyond_range, 1);
  EXPECT_EQ(buffer.counts().out_of_order, 2);
  EXPECT_EQ(buffer.counts().refused(), 5);
  EXPECT_EQ(buffer.counts().accepted, 16);
  EXPECT_EQ(buffer.samples().size(), 16u);
  const auto steps = buffer.Steps(FromSeconds(0), FromSeconds(0.2));
  EXPECT_TRUE(AllMeasured(steps));
  for (const ImuStep& step : steps) EXPECT_TRUE(step.gyro_rad_s.allFinite());
}

TEST(ImuBuffer, OldSamplesAreForgotten) {
  ImuBufferOptions options;
  options.keep_s = 0.5;
  ImuBuffer buffer(options);
  buffer.Add(SamplesUpTo(2));
  EXPECT_NEAR(ToSeconds(buffer.samples().front().time), 1.5, 0.011);
}

}  // namespace
}  // namespace portolan
