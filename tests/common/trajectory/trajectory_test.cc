#include "common/trajectory/trajectory.h"

#include <limits>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/support/matchers.h"

namespace portolan {
namespace {

using std::chrono::milliseconds;
using testing::HasSubstr;

StampedPose PoseAt(int milliseconds_count, double x) {
  return {milliseconds(milliseconds_count), {Eigen::Quaterniond::Identity(), {x, 0, 0}}};
}

TEST(ValidateTrajectory, RejectsWhatIsNotATrajectory) {
  EXPECT_THAT(ValidateTrajectory({}), IsOk());
  EXPECT_THAT(ValidateTrajectory({PoseAt(0, 0), PoseAt(1, 1)}), IsOk());
  EXPECT_THAT(ValidateTrajectory({PoseAt(1, 0), PoseAt(1, 1)}),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("pose 1: time")));
  EXPECT_THAT(ValidateTrajectory({PoseAt(0, std::numeric_limits<double>::quiet_NaN())}),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("not finite")));
  StampedPose stretched = PoseAt(0, 0);
  stretched.world_from_body.rotation.coeffs() *= 1.1;
  EXPECT_THAT(ValidateTrajectory({stretched}),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("unit norm")));
}

TEST(PathLength, SumsSteps) {
  const Trajectory trajectory = {PoseAt(0, 0), PoseAt(1, 3), PoseAt(2, 1)};
  EXPECT_THAT(CumulativePathLength(trajectory), testing::ElementsAre(0, 3, 5));
  EXPECT_DOUBLE_EQ(PathLength(trajectory), 5);
  EXPECT_DOUBLE_EQ(PathLength({}), 0);
}

TEST(InterpolatePose, IsLinearInPositionAndGeodesicInRotation) {
  Trajectory trajectory = {PoseAt(0, 0), PoseAt(100, 2)};
  trajectory[1].world_from_body.rotation = RotationExp({0, 0, 1.2});
  const auto pose = InterpolatePose(trajectory, milliseconds(25));
  ASSERT_TRUE(pose);
  EXPECT_THAT(*pose, NearRigid(Rigid3{RotationExp({0, 0, 0.3}), {0.5, 0, 0}}, 1e-12));
}

TEST(InterpolatePose, HasNoValueOutsideOrInAGap) {
  const Trajectory trajectory = {PoseAt(0, 0), PoseAt(100, 2), PoseAt(5000, 3)};
  EXPECT_FALSE(InterpolatePose(trajectory, milliseconds(-1)));
  EXPECT_FALSE(InterpolatePose(trajectory, milliseconds(5001)));
  EXPECT_FALSE(InterpolatePose(trajectory, milliseconds(200)));
  EXPECT_TRUE(InterpolatePose(trajectory, milliseconds(0)));
  EXPECT_TRUE(InterpolatePose(trajectory, milliseconds(5000)));
  EXPECT_FALSE(InterpolatePose({}, milliseconds(0)));
}

TEST(ResampleTrajectory, LeavesOutTimesWithoutPose) {
  const Trajectory trajectory = {PoseAt(0, 0), PoseAt(100, 2)};
  const std::vector<Timestamp> times = {milliseconds(-5), milliseconds(50), milliseconds(100)};
  const Trajectory resampled = ResampleTrajectory(trajectory, times);
  ASSERT_EQ(resampled.size(), 2u);
  EXPECT_EQ(resampled[0].time, milliseconds(50));
  EXPECT_DOUBLE_EQ(resampled[0].world_from_body.translation.x(), 1);
}

TEST(AssociateByTime, TakesTheNearestWithinTheLimit) {
  const Trajectory estimate = {PoseAt(0, 0), PoseAt(104, 0), PoseAt(151, 0), PoseAt(300, 0)};
  const Trajectory reference = {PoseAt(1, 0), PoseAt(50, 0), PoseAt(100, 0), PoseAt(150, 0)};
  const auto pairs = AssociateByTime(estimate, reference, milliseconds(5));
  ASSERT_EQ(pairs.size(), 3u);
  EXPECT_EQ(pairs[0].reference, 0u);
  EXPECT_EQ(pairs[1].estimate, 1u);
  EXPECT_EQ(pairs[1].reference, 2u);
  EXPECT_EQ(pairs[2].reference, 3u);
}

TEST(AssociateByTime, UsesEachReferenceOnce) {
  const Trajectory estimate = {PoseAt(90, 0), PoseAt(97, 0), PoseAt(101, 0), PoseAt(103, 0)};
  const Trajectory reference = {PoseAt(0, 0), PoseAt(100, 0)};
  const auto pairs = AssociateByTime(estimate, reference, milliseconds(20));
  ASSERT_EQ(pairs.size(), 1u);
  EXPECT_EQ(pairs[0].estimate, 2u);
}

TEST(AssociateByTime, IsEmptyForEmptyInput) {
  EXPECT_TRUE(AssociateByTime({}, {PoseAt(0, 0)}, milliseconds(5)).empty());
  EXPECT_TRUE(AssociateByTime({PoseAt(0, 0)}, {}, milliseconds(5)).empty());
}

}  // namespace
}  // namespace portolan
