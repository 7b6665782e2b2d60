#include "agent/range/range_scale.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <numbers>
#include <random>

#include "tests/agent/filter/point_world.h"
#include "tests/support/matchers.h"

namespace portolan {
namespace {

using absl::StatusCode;
using testing::HasSubstr;

constexpr double kRateHz = 20;

RangeFinder MakeFinder() {
  RangeFinder finder;
  finder.position_in_camera_m = {0.1, -0.08, 0.02};
  finder.direction_in_camera = Eigen::Vector3d(-0.05, 0.03, 1).normalized();
  finder.sigma_m = 0.02;
  finder.max_range_m = 30;
  return finder;
}

// Along a ray of the world to the walls of a room of 12 x 10 x 5 m about the origin.
double DistanceToWalls(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) {
  const Eigen::Vector3d half(6, 2.5, 5);
  double nearest = 1e9;
  for (int axis = 0; axis < 3; ++axis) {
    if (std::abs(direction[axis]) < 1e-9) continue;
    const double wall = direction[axis] > 0 ? half[axis] : -half[axis];
    nearest = std::min(nearest, (wall - origin[axis]) / direction[axis]);
  }
  return nearest;
}

// Round the room in 30 s, looking outwards and ahead.
Rigid3 RoundTheRoom(double time_s) {
  const double angle = 2 * std::numbers::pi * time_s / 30;
  return {RotationExp({0, angle, 0}) * RotationExp({0.05 * std::sin(3 * angle), 0.6, 0}),
          Eigen::Vector3d(2.5 * std::sin(angle), 0.3 * std::sin(4 * angle), 2.5 * std::cos(angle))};
}

struct RoomRun {
  double range_every_s = 0.1;
  double range_share_wrong = 0;
  // From then to then there are no ranges.
  double gap_from_s = 1e9, gap_to_s = 1e9;
  // Until then ranges are too long by this.
  double range_factor = 1, factor_until_s = 0;
  double duration_s = 20;
  int submap_frames = 40;
  uint64_t seed = 1;
  RangeOptions options = {};
};

// A filter in the room with ranges, the whole of it.
class RangeScaleTest : public testing::Test {
 protected:
  void Start(const RoomRun& run) {
    run_ = run;
    random_.seed(100 + run.seed);
    next_range_s_ = 0;
    frame_ = 0;
    scales_.clear();
    spots_.clear();
    PointWorldOptions world;
    world.rate_hz = kRateHz;
    world.pixel_sigma = 0.7;
    world.landmarks = 50;
    world.seed = run.seed;
    world.depth = [](const Rigid3& pose, const Eigen::Vector3d& bearing) {
      return DistanceToWalls(pose.translation, pose.rotation * bearing);
    };
    world_.emplace(world, MakeTestCamera(), RoundTheRoom);
    filter_ = LocalFilter::Create({}, MakeTestCamera(), nullptr).value();
    ranges_.emplace(*RangeScale::Create(run.options, MakeFinder(), MakeTestCamera()));
    world_->Start(filter_.get());
  }

  void Step() {
    world_->Step(filter_.get());
    AddRange();
    if (const auto scale = ranges_->Use(SeenSpots(), filter_.get())) scales_.push_back(*scale);
    FollowSpot();
    ++frame_;
    if (frame_ % run_.submap_frames != 0) return;
    // As the agent does: a submap takes its scale before it ends.
    ranges_->CorrectScale(filter_.get());
    const Rigid3 old_from_new = filter_->submap_from_camera();
    world_->BeginSubmap(filter_.get());
    ranges_->Rebase(old_from_new);
  }

  // The rest of the run; RMS of what the scale is off while it counts as metric.
  double RunAndMeasure() {
    double sum = 0;
    int count = 0;
    while (world_->time_s() < run_.duration_s) {
      Step();
      if (!filter_->metric()) continue;
      sum += (Scale() - 1) * (Scale() - 1);
      ++count;
    }
    EXPECT_GT(count, kRateHz * run_.duration_s / 2);
    return std::sqrt(sum / count);
  }

  // Median of estimated over true distance of the known landmarks from the camera.
  double Scale() const {
    std::vector<double> ratios;
    const Rigid3 estimate = filter_->submap_from_camera(),
                 truth = world_->true_submap_from_camera();
    for (const LandmarkEstimate& landmark : filter_->Landmarks()) {
      if (landmark.inverse_depth < 10 * landmark.inverse_depth_sigma) continue;
      ratios.push_back((landmark.point_in_submap - estimate.translation).norm() /
                       (world_->true_point_in_submap(landmark.track) - truth.translation).norm());
    }
    EXPECT_GE(ratios.size(), 10u);
    if (ratios.empty()) return 0;
    const auto middle = ratios.begin() + static_cast<std::ptrdiff_t>(ratios.size() / 2);
    std::nth_element(ratios.begin(), middle, ratios.end());
    return *middle;
  }

  RoomRun run_;
  std::optional<PointWorld> world_;
  std::unique_ptr<LocalFilter> filter_;
  std::optional<RangeScale> ranges_;
  std::vector<double> scales_;

 private:
  // A while before the image; where the laser meets the wall then is what is tracked.
  void AddRange() {
    const double time = world_->time_s();
    if (time >= run_.gap_from_s && time < run_.gap_to_s) return;
    if (time < next_range_s_) return;
    next_range_s_ = time + run_.range_every_s;
    const double then = time - 0.04;
    const Rigid3 pose = RoundTheRoom(then);
    const RangeFinder finder = MakeFinder();
    const Eigen::Vector3d origin = pose * finder.position_in_camera_m;
    const Eigen::Vector3d direction = pose.rotation * finder.direction_in_camera;
    double range = DistanceToWalls(origin, direction);
    spot_in_world_ = origin + range * direction;
    std::normal_distribution<double> noise(0, finder.sigma_m);
    std::uniform_real_distribution<double> uniform(0, 1);
    if (time < run_.factor_until_s) range *= run_.range_factor;
    range += noise(random_);
    if (uniform(random_) < run_.range_share_wrong) range *= 0.3 + 0.4 * uniform(random_);
    ranges_->AddSamples({{RangeSample{FromSeconds(then), range, 0}}});
  }

  void FollowSpot() {
    const auto pixel = ranges_->SpotToFollow();
    if (!pixel) return;
    const auto truth =
        MakeTestCamera().Project(RoundTheRoom(world_->time_s()).Inverse() * spot_in_world_);
    // The offset of the finder is in metres: without a scale the camera's way is a guess, not more.
    ASSERT_TRUE(truth);
    if (run_.range_share_wrong == 0 && run_.range_factor == 1) {
      EXPECT_LT((*pixel - *truth).norm(), filter_->has_scale() ? 1.5 : 8);
    }
    spots_[TrackId(next_track_)] = spot_in_world_;
    ranges_->Follow(TrackId(next_track_++));
  }

  std::vector<TrackedPoint> SeenSpots() {
    const Rigid3 camera_from_world = RoundTheRoom(world_->time_s()).Inverse();
    std::normal_distribution<double> noise(0, 0.7);
    std::vector<TrackedPoint> seen;
    for (const auto& [track, point] : spots_) {
      const auto pixel = MakeTestCamera().Project(camera_from_world * point);
      if (!pixel || !MakeTestCamera().IsInImage(*pixel, 10)) continue;
      seen.push_back({track, *pixel + Eigen::Vector2d(noise(random_), noise(random_)), 0.7, 1});
    }
    return seen;
  }

  std::mt19937_64 random_;
  int frame_ = 0;
  double next_range_s_ = 0;
  Eigen::Vector3d spot_in_world_ = Eigen::Vector3d::Zero();
  std::map<TrackId, Eigen::Vector3d> spots_;
  uint32_t next_track_ = 1000000;
};

TEST_F(RangeScaleTest, MakesTheMapMetric) {
  for (uint64_t seed = 1; seed <= 3; ++seed) {
    Start({.seed = seed});
    const double rms = RunAndMeasure();
    std::printf("10 Hz, seed %d: scale off by %.2f %% RMS, at the end by %.2f %%\n",
                static_cast<int>(seed), 100 * rms, 100 * (Scale() - 1));
    EXPECT_TRUE(filter_->metric());
    EXPECT_EQ(scales_.size(), 1u);
    EXPECT_LT(rms, 0.02);
    EXPECT_NEAR(Scale(), 1, 0.02);
    EXPECT_LT(ranges_->counts().rejected, 5);
    EXPECT_GT(ranges_->counts().used, 50);
  }
}

TEST_F(RangeScaleTest, WithoutRangesTheScaleIsFreeAndDrifts) {
  double drift = 0;
  for (uint64_t seed = 1; seed <= 2; ++seed) {
    Start({.range_every_s = 1e9, .seed = seed});
    while (world_->time_s() < 4) Step();
    const double early = Scale();
    EXPECT_GT(std::abs(std::log(early)), 0.5);
    while (world_->time_s() < 20) Step();
    EXPECT_FALSE(filter_->metric());
    EXPECT_TRUE(scales_.empty());
    drift += std::log(Scale() / early) / 2;
  }
  std::printf("no ranges: the scale drifts by %.2f %%\n", 100 * drift);
  // What the ranges hold in the test above.
  EXPECT_GT(std::abs(drift), 0.008);
}

TEST_F(RangeScaleTest, ARangeNowAndThenIsEnough) {
  for (uint64_t seed = 1; seed <= 2; ++seed) {
    Start({.range_every_s = 1, .seed = seed});
    const double rms = RunAndMeasure();
    std::printf("1 Hz, seed %d: scale off by %.2f %% RMS, at the end by %.2f %%\n",
                static_cast<int>(seed), 100 * rms, 100 * (Scale() - 1));
    EXPECT_TRUE(filter_->metric());
    EXPECT_LT(rms, 0.025);
  }
}

TEST_F(RangeScaleTest, WrongRangesAreRejected) {
  Start({.range_share_wrong = 0.2});
  EXPECT_LT(RunAndMeasure(), 0.02);
  EXPECT_EQ(scales_.size(), 1u);
  EXPECT_GT(ranges_->counts().rejected, 8);
}

TEST_F(RangeScaleTest, AfterALongGapTheMapIsNotCalledMetricUntilARangeFits) {
  Start({.gap_from_s = 6, .gap_to_s = 18});
  while (world_->time_s() < 14) Step();
  EXPECT_TRUE(filter_->metric());
  while (world_->time_s() < 17.8) Step();
  EXPECT_FALSE(filter_->metric());
  while (world_->time_s() < 24) Step();
  EXPECT_TRUE(filter_->metric());
  EXPECT_EQ(scales_.size(), 1u);
  EXPECT_NEAR(Scale(), 1, 0.02);
}

TEST_F(RangeScaleTest, AWrongScaleIsReplaced) {
  Start({.range_factor = 1.6, .factor_until_s = 6});
  while (world_->time_s() < 6) Step();
  EXPECT_NEAR(Scale(), 1.6, 0.05);
  while (world_->time_s() < 20) Step();
  EXPECT_EQ(scales_.size(), 2u);
  EXPECT_NEAR(Scale(), 1, 0.03);
}

TEST_F(RangeScaleTest, NothingIsUsedWhileTheStartIsGathered) {
  Start({});
  ASSERT_TRUE(filter_->starting());
  while (filter_->starting()) {
    EXPECT_EQ(ranges_->counts().followed, 0);
    EXPECT_FALSE(filter_->metric());
    Step();
  }
  EXPECT_LT(world_->time_s(), 5);
}

TEST_F(RangeScaleTest, AnotherSensorsMetreIsNotReplaced) {
  Start({});
  filter_->TakeMetricDepths(1);
  while (world_->time_s() < 8) Step();
  EXPECT_TRUE(filter_->metric());
  EXPECT_FALSE(filter_->has_scale());
  EXPECT_TRUE(scales_.empty());
  EXPECT_GT(ranges_->counts().used + ranges_->counts().rejected, 0);
}

TEST_F(RangeScaleTest, AStartForgetsTheScale) {
  Start({});
  while (world_->time_s() < 8) Step();
  ASSERT_TRUE(filter_->metric());
  ASSERT_GT(ranges_->scale_sigma(), 0);
  filter_->Start(world_->time());
  ranges_->Reset();
  EXPECT_FALSE(filter_->metric());
  EXPECT_FALSE(filter_->has_scale());
  EXPECT_EQ(ranges_->scale_sigma(), 0);
  EXPECT_FALSE(ranges_->SpotToFollow());
}

TEST(RangeScale, RefusesAFinderThatTheCameraNeverSees) {
  RangeFinder finder = MakeFinder();
  finder.direction_in_camera = {0, 0, -1};
  EXPECT_THAT(RangeScale::Create({}, finder, MakeTestCamera()),
              StatusIs(StatusCode::kInvalidArgument, HasSubstr("never sees")));
  finder.direction_in_camera = {0, 0, 2};
  EXPECT_FALSE(RangeScale::Create({}, finder, MakeTestCamera()).ok());
  finder = MakeFinder();
  finder.max_range_m = finder.min_range_m;
  EXPECT_FALSE(RangeScale::Create({}, finder, MakeTestCamera()).ok());
  EXPECT_THAT(RangeScale::Create({}, MakeFinder(), MakeTestFisheye()), IsOk());
}

TEST(RangeOptions, AreChecked) {
  EXPECT_THAT(RangeOptions().Validate(), IsOk());
  for (double RangeOptions::*member :
       {&RangeOptions::max_age_s, &RangeOptions::spot_interval_s, &RangeOptions::min_parallax_rad,
        &RangeOptions::max_depth_sigma_ratio, &RangeOptions::good_depth_sigma_ratio,
        &RangeOptions::spot_sigma, &RangeOptions::map_sigma, &RangeOptions::scale_drift,
        &RangeOptions::gate_chi2, &RangeOptions::trusted_gap_s}) {
    for (const double wrong : {0.0, -1.0, std::nan(""), HUGE_VAL}) {
      RangeOptions options;
      options.*member = wrong;
      EXPECT_THAT(options.Validate(), StatusIs(StatusCode::kInvalidArgument));
    }
  }
  RangeOptions options;
  options.max_rejected_in_row = 0;
  EXPECT_FALSE(options.Validate().ok());
  options = {};
  options.max_spots = 0;
  EXPECT_FALSE(options.Validate().ok());
  options = {};
  options.scale.min_ranges = 1;
  EXPECT_FALSE(options.Validate().ok());
}

}  // namespace
}  // namespace portolan
