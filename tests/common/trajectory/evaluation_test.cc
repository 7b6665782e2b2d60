#include "common/trajectory/evaluation.h"

#include <cmath>

#include "common/trajectory/trajectory_io.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/support/data_path.h"
#include "tests/support/matchers.h"

namespace portolan {
namespace {

using std::chrono::milliseconds;
using testing::HasSubstr;

// A circle of radius 2 m at 20 Hz, once round in `poses` frames, the body looking along its path.
Trajectory Circle(int poses, const Eigen::Vector3d& centre, int first_ms = 0) {
  Trajectory trajectory;
  for (int i = 0; i < poses; ++i) {
    const double angle = 2 * M_PI * i / poses;
    trajectory.push_back({milliseconds(first_ms + 50 * i),
                          {RotationExp({0, 0, angle}),
                           centre + 2.0 * Eigen::Vector3d(std::cos(angle), std::sin(angle), 0)}});
  }
  return trajectory;
}

Trajectory Moved(const Similarity3& transform, Trajectory trajectory) {
  for (StampedPose& pose : trajectory) pose.world_from_body = transform * pose.world_from_body;
  return trajectory;
}

EvaluationOptions With(AlignmentMode mode) {
  EvaluationOptions options;
  options.alignment = mode;
  return options;
}

TEST(ComputeStatistics, AreTheTextbookOnes) {
  const ErrorStatistics statistics = ComputeStatistics({4, 1, 3, 2});
  EXPECT_EQ(statistics.count, 4u);
  EXPECT_DOUBLE_EQ(statistics.rmse, std::sqrt(30.0 / 4));
  EXPECT_DOUBLE_EQ(statistics.mean, 2.5);
  EXPECT_DOUBLE_EQ(statistics.median, 2.5);
  EXPECT_DOUBLE_EQ(statistics.min, 1);
  EXPECT_DOUBLE_EQ(statistics.max, 4);
  EXPECT_DOUBLE_EQ(statistics.standard_deviation, std::sqrt(1.25));
  EXPECT_EQ(ComputeStatistics({}).count, 0u);
}

TEST(EvaluateTrajectories, AMovedCopyHasNoError) {
  const Trajectory truth = Circle(100, {1, 2, 3});
  const Trajectory estimate = Moved({0.25, RotationExp({1, 2, 0.5}), {4, 5, 6}}, truth);
  const TrajectoryPair agent{"a", &estimate, &truth};
  const auto evaluation = EvaluateTrajectories({&agent, 1}, With(AlignmentMode::kSim3));
  ASSERT_THAT(evaluation, IsOk());
  EXPECT_NEAR(evaluation->joint.ate_m.max, 0, 1e-9);
  EXPECT_NEAR(evaluation->joint.rotation_rad.max, 0, 1e-7);
  EXPECT_NEAR(evaluation->joint.rpe_per_m.translation.max, 0, 1e-9);
  EXPECT_NEAR(evaluation->joint.reference_from_estimate.scale, 4, 1e-9);
  EXPECT_DOUBLE_EQ(evaluation->joint.coverage, 1);
}

// Closed form: radii 2 m and 2 (1 + e) m about one centre, so SE(3) leaves 2 e everywhere.
TEST(EvaluateTrajectories, ScaleErrorRemainsUnderSe3) {
  const Trajectory truth = Circle(100, {0, 0, 0});
  const Trajectory estimate = Moved({1.03, RotationExp({0, 0, 1}), {4, 5, 6}}, truth);
  const TrajectoryPair agent{"a", &estimate, &truth};
  for (const auto mode : {AlignmentMode::kSe3, AlignmentMode::kYaw}) {
    const auto evaluation = EvaluateTrajectories({&agent, 1}, With(mode));
    ASSERT_THAT(evaluation, IsOk());
    EXPECT_NEAR(evaluation->joint.ate_m.rmse, 0.06, 1e-9);
    EXPECT_NEAR(evaluation->joint.ate_m.median, 0.06, 1e-9);
    EXPECT_NEAR(evaluation->joint.scale_error.value(), 0.03, 1e-9);
    EXPECT_NEAR(evaluation->joint.rpe_per_s.translation.mean,
                0.03 * 2 * 2 * std::sin(M_PI * 20 / 100), 1e-9);
  }
}

TEST(EvaluateTrajectories, NoneTakesTheEstimateAsItIs) {
  const Trajectory truth = Circle(40, {0, 0, 0});
  const Trajectory estimate = Moved({1, Eigen::Quaterniond::Identity(), {0.3, 0, 0.4}}, truth);
  const TrajectoryPair agent{"a", &estimate, &truth};
  const auto evaluation = EvaluateTrajectories({&agent, 1}, With(AlignmentMode::kNone));
  ASSERT_THAT(evaluation, IsOk());
  EXPECT_NEAR(evaluation->joint.ate_m.rmse, 0.5, 1e-9);
}

// Two perfect agents of which one was merged 1 m off: alone both are right, jointly neither is.
TEST(EvaluateTrajectories, JointAlignmentShowsWhatEachAloneHides) {
  const Trajectory truth_a = Circle(100, {0, 0, 0}), truth_b = Circle(100, {10, 0, 0});
  const Trajectory off = Moved({1, Eigen::Quaterniond::Identity(), {0, 0, 1}}, truth_b);
  const TrajectoryPair agents[] = {{"a", &truth_a, &truth_a}, {"b", &off, &truth_b}};
  const auto evaluation = EvaluateTrajectories(agents, With(AlignmentMode::kSe3));
  ASSERT_THAT(evaluation, IsOk());
  ASSERT_EQ(evaluation->agents_alone.size(), 2u);
  EXPECT_NEAR(evaluation->agents_alone[0]->ate_m.max, 0, 1e-9);
  EXPECT_NEAR(evaluation->agents_alone[1]->ate_m.max, 0, 1e-9);
  EXPECT_GT(evaluation->joint.ate_m.rmse, 0.1);
  EXPECT_GT(evaluation->agents_in_joint[1].ate_m.rmse, 0.1);
  EXPECT_EQ(evaluation->joint.ate_m.count, 200u);
  const double squares = std::pow(evaluation->agents_in_joint[0].ate_m.rmse, 2) +
                         std::pow(evaluation->agents_in_joint[1].ate_m.rmse, 2);
  EXPECT_NEAR(evaluation->joint.ate_m.rmse, std::sqrt(squares / 2), 1e-9);
}

TEST(EvaluateTrajectories, CoverageCountsReferenceStamps) {
  const Trajectory truth = Circle(100, {0, 0, 0});
  const Trajectory half(truth.begin(), truth.begin() + 50);
  const Trajectory rest(truth.begin() + 50, truth.begin() + 90);
  const TrajectoryPair agents[] = {{"a", &half, &truth}, {"b", &rest, &truth}};
  const auto evaluation = EvaluateTrajectories(agents, With(AlignmentMode::kSe3));
  ASSERT_THAT(evaluation, IsOk());
  EXPECT_DOUBLE_EQ(evaluation->agents_in_joint[0].coverage, 0.5);
  EXPECT_DOUBLE_EQ(evaluation->agents_in_joint[1].coverage, 0.4);
  EXPECT_DOUBLE_EQ(evaluation->joint.coverage, 0.9);  // one reference, shared
}

TEST(EvaluateTrajectories, CoverageHasATolerance) {
  const Trajectory truth = Circle(100, {0, 0, 0});
  Trajectory late = Circle(100, {0, 0, 0}, 19);
  const TrajectoryPair agent{"a", &late, &truth};
  EXPECT_DOUBLE_EQ(EvaluateTrajectories({&agent, 1}, With(AlignmentMode::kSe3))->joint.coverage, 1);
  late = Circle(100, {0, 0, 0}, 21);
  EXPECT_THAT(EvaluateTrajectories({&agent, 1}, With(AlignmentMode::kSe3)),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("only 0 poses")));
}

TEST(EvaluateTrajectories, AnAgentWithoutAMatchIsListed) {
  const Trajectory truth = Circle(100, {0, 0, 0}), nothing;
  const TrajectoryPair agents[] = {{"a", &truth, &truth}, {"lost", &nothing, &truth}};
  const auto evaluation = EvaluateTrajectories(agents, With(AlignmentMode::kSim3));
  ASSERT_THAT(evaluation, IsOk());
  EXPECT_EQ(evaluation->agents_in_joint[1].ate_m.count, 0u);
  EXPECT_DOUBLE_EQ(evaluation->agents_in_joint[1].coverage, 0);
  EXPECT_FALSE(evaluation->agents_alone[1]);
}

TEST(EvaluateTrajectories, RejectsBadInput) {
  const Trajectory truth = Circle(10, {0, 0, 0});
  const TrajectoryPair agent{"a", &truth, &truth};
  EvaluationOptions options;
  EXPECT_THAT(EvaluateTrajectories({}, options), StatusIs(absl::StatusCode::kInvalidArgument));
  options.rpe_time_s = -1;
  EXPECT_THAT(EvaluateTrajectories({&agent, 1}, options),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("rpe_time_s")));
}

// The data set's README states 5 cm rms, 11 cm at most and 0.2 % of scale between its two ground
// truths, from another program.
TEST(EvaluateTrajectories, AgreesWithTheFiguresOfRedkitchen) {
  PORTOLAN_REAL_DATA_OR_SKIP(folder, "7scenes/redkitchen_seq-01");
  const auto truth = ReadTrajectory((folder / "groundtruth.txt").string());
  const auto fusion = ReadTrajectory((folder / "groundtruth_kinectfusion.txt").string());
  ASSERT_THAT(truth, IsOk());
  ASSERT_THAT(fusion, IsOk());
  const TrajectoryPair agent{"fusion", &*fusion, &*truth};
  const auto evaluation = EvaluateTrajectories({&agent, 1}, With(AlignmentMode::kSe3));
  ASSERT_THAT(evaluation, IsOk());
  EXPECT_EQ(evaluation->joint.ate_m.count, 910u);
  EXPECT_NEAR(evaluation->joint.ate_m.rmse, 0.05, 0.005);
  EXPECT_NEAR(evaluation->joint.ate_m.max, 0.11, 0.005);
  EXPECT_NEAR(std::abs(evaluation->joint.scale_error.value()), 0.002, 0.0005);
  EXPECT_NEAR(evaluation->joint.reference_path_m, 8.0, 0.05);
}

TEST(EvaluateTrajectories, KittiFilesAgreeWithEachOther) {
  PORTOLAN_REAL_DATA_OR_SKIP(folder, "kitti/odometry_00_first200");
  const auto truth = ReadTrajectory((folder / "groundtruth.txt").string());
  const auto poses =
      ReadKittiTrajectory((folder / "poses_kitti.txt").string(), (folder / "times.txt").string());
  ASSERT_THAT(truth, IsOk());
  ASSERT_THAT(poses, IsOk());
  const TrajectoryPair agent{"kitti", &*poses, &*truth};
  const auto evaluation = EvaluateTrajectories({&agent, 1}, With(AlignmentMode::kNone));
  ASSERT_THAT(evaluation, IsOk());
  EXPECT_EQ(evaluation->joint.ate_m.count, 200u);
  EXPECT_LT(evaluation->joint.ate_m.max, 1e-4);
  EXPECT_LT(evaluation->joint.rotation_rad.max, 1e-5);
  EXPECT_NEAR(evaluation->joint.reference_path_m, 145, 0.5);
}

}  // namespace
}  // namespace portolan
