#include "agent/filter/start_smoother.h"

#include <gtest/gtest.h>

#include "tests/agent/filter/point_world.h"

namespace portolan {
namespace {

ConstantVelocityOptions SlowMotion() {
  ConstantVelocityOptions motion;
  motion.linear_acceleration = 0.2;
  motion.angular_acceleration = 0.2;
  motion.initial_linear_velocity_sigma = 0.2;
  motion.initial_angular_velocity_sigma = 0.1;
  return motion;
}

struct Flight {
  explicit Flight(uint64_t seed, bool smoothed)
      : world(Options(seed), MakeTestCamera(), RandomTrajectory(SlowMotion(), 30, 3, 1000 + seed)) {
    FilterOptions options;
    options.start.enabled = smoothed;
    options.model_sigma_px = 0;
    filter = LocalFilter::Create(options, MakeTestCamera(),
                                 std::make_unique<ConstantVelocityModel>(SlowMotion()))
                 .value();
    world.Start(filter.get());
  }
  static PointWorldOptions Options(uint64_t seed) {
    PointWorldOptions options;
    options.seed = seed;
    return options;
  }
  // Cosine between the camera's way and the true one.
  double Agreement() const {
    return filter->submap_from_camera().translation.normalized().dot(
        world.true_submap_from_camera().translation.normalized());
  }
  PointWorld world;
  std::unique_ptr<LocalFilter> filter;
};

TEST(StartSmoother, FindsTheMotionWhereTheFilterReversedIt) {
  // Of 200 starts these are the ones in which frame by frame near and far are exchanged.
  for (const uint64_t seed : {36, 125}) {
    Flight plain(seed, false), smoothed(seed, true);
    for (int frame = 0; frame < 30; ++frame) {
      plain.world.Step(plain.filter.get());
      smoothed.world.Step(smoothed.filter.get());
    }
    EXPECT_LT(plain.Agreement(), 0) << seed;
    EXPECT_GT(smoothed.Agreement(), 0.9) << seed;
    EXPECT_TRUE(smoothed.filter->state().IsCovarianceValid());
  }
}

TEST(StartSmoother, GivesThePosesOfTheStartAnew) {
  Flight run(2, true);
  int restated = 0;
  for (int frame = 1; frame <= 45; ++frame) {
    run.world.Step(run.filter.get());
    const auto poses = run.filter->TakeRestatedPoses();
    if (poses.empty()) continue;
    ++restated;
    EXPECT_EQ(poses.front().second.translation.norm(), 0);
    EXPECT_EQ(poses.back().first, run.filter->time());
    EXPECT_LT(
        (poses.back().second.translation - run.filter->submap_from_camera().translation).norm(),
        1e-9);
  }
  EXPECT_GT(restated, 0);
  EXPECT_TRUE(run.filter->TakeRestatedPoses().empty());
}

TEST(StartSmoother, IsSilentWhenDisabled) {
  Flight run(2, false);
  for (int frame = 1; frame <= 45; ++frame) {
    run.world.Step(run.filter.get());
    EXPECT_TRUE(run.filter->TakeRestatedPoses().empty());
  }
}

TEST(StartSmoother, RefusesOptionsOutOfRange) {
  StartSmootherOptions options;
  EXPECT_TRUE(options.Validate().ok());
  options.max_frames = 15;
  EXPECT_FALSE(options.Validate().ok());
}

TEST(ConstantVelocityModel, ErrorOfACorrectedCopyIsTheCorrection) {
  const ConstantVelocityModel model(SlowMotion());
  const auto copy = model.Clone();
  Eigen::VectorXd error(12);
  error << 0.1, -0.2, 0.3, 0.02, 0.01, -0.03, 1, 2, 3, -1, 0.5, 0.2;
  copy->Correct(error);
  EXPECT_LT((model.ErrorOf(*copy) - error).norm(), 1e-12);
}

}  // namespace
}  // namespace portolan
