#include "common/trajectory/relative_error.h"

#include <cmath>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace portolan {
namespace {

using testing::DoubleNear;
using testing::Each;
using testing::SizeIs;

// A straight path along x with 1 m steps at 10 Hz; the estimate is `stretch` times as long and
// turns by `turn_rad` more than the truth at every step.
std::vector<MatchedPose> StraightPath(int poses, double stretch, double turn_rad) {
  std::vector<MatchedPose> path;
  for (int i = 0; i < poses; ++i) {
    MatchedPose pose;
    pose.time = std::chrono::milliseconds(100 * i);
    pose.reference.translation.x() = i;
    pose.estimate.translation.x() = stretch * i;
    pose.estimate.rotation = RotationExp({0, 0, turn_rad * i});
    pose.path_m = i;
    path.push_back(pose);
  }
  return path;
}

TEST(RatesPerMetre, AreTheStretch) {
  const auto rates = RatesPerMetre(StraightPath(50, 1.02, 0), 5.0);
  EXPECT_THAT(rates.translation, SizeIs(45));
  EXPECT_THAT(rates.translation, Each(DoubleNear(0.02, 1e-12)));
  EXPECT_THAT(rates.rotation_rad, Each(DoubleNear(0, 1e-9)));
}

TEST(RatesPerSecond, AreTheTurnRate) {
  const auto rates = RatesPerSecond(StraightPath(50, 1.0, 0.003), 1.0);
  EXPECT_THAT(rates.rotation_rad, SizeIs(40));
  EXPECT_THAT(rates.rotation_rad, Each(DoubleNear(0.03, 1e-9)));
}

TEST(RatesPerMetre, DoNotDependOnTheFrameOfTheEstimate) {
  auto path = StraightPath(30, 1.05, 0.0);
  const Rigid3 moved{RotationExp({0.3, 2, -1}), {10, 20, 30}};
  for (MatchedPose& pose : path) pose.estimate = moved * pose.estimate;
  EXPECT_THAT(RatesPerMetre(path, 2.0).translation, Each(DoubleNear(0.05, 1e-9)));
}

TEST(RatesPerMetre, LeaveOutGapsAndShortPaths) {
  auto path = StraightPath(20, 1.0, 0);
  path.erase(path.begin() + 5, path.begin() + 12);
  // Intervals that would bridge the seven missing poses are longer than 1.5 m.
  EXPECT_THAT(RatesPerMetre(path, 1.0).translation, SizeIs(11));
  EXPECT_THAT(RatesPerMetre(path, 100.0).translation, SizeIs(0));
  EXPECT_THAT(RatesPerMetre({}, 1.0).translation, SizeIs(0));
}

// The benchmark's program ends a segment at the first pose beyond the length, here one metre
// later, and divides by the nominal length.
TEST(KittiSegments, FollowTheBenchmarkProgram) {
  const auto rates = KittiSegments(StraightPath(302, 1.01, 0.0));
  // Starts 0, 10, ..., 200 reach 100 m, 0 ... 100 reach 200 m, 0 reaches 300 m.
  ASSERT_THAT(rates.translation, SizeIs(21 + 11 + 1));
  EXPECT_NEAR(rates.translation[0], 0.01 * 101 / 100, 1e-12);
  EXPECT_NEAR(rates.translation[1], 0.01 * 201 / 200, 1e-12);
  EXPECT_NEAR(rates.translation[2], 0.01 * 301 / 300, 1e-12);
}

TEST(KittiSegments, NeedAHundredMetres) {
  EXPECT_THAT(KittiSegments(StraightPath(101, 1.0, 0)).translation, SizeIs(0));
  EXPECT_THAT(KittiSegments(StraightPath(102, 1.0, 0)).translation, SizeIs(1));
}

}  // namespace
}  // namespace portolan
