#include "agent/filter/known_depths.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "agent/filter/local_filter.h"
#include "tests/agent/filter/point_world.h"
#include "tests/support/matchers.h"

namespace portolan {
namespace {

constexpr double kKnown = 0.25;

// A filter that has moved for a while, so that it has rays, points and anchors.
class KnownDepthsTest : public testing::Test {
 protected:
  KnownDepthsTest() {
    FilterOptions options;
    options.linearity_threshold = 0.1;
    filter_ = LocalFilter::Create(options, MakeTestCamera(), nullptr).value();
    world_.Start(filter_.get());
  }

  void Move(int frames) {
    for (int i = 0; i < frames; ++i) world_.Step(filter_.get());
  }

  double VarianceOfLogMean(double max_sigma_ratio) const {
    const Eigen::RowVectorXd d_log =
        MeanOfKnownDepths(filter_->state(), max_sigma_ratio).d_log_d_state;
    return d_log * filter_->state().covariance() * d_log.transpose();
  }

  PointWorld world_{{}, MakeTestCamera(), SwayingTrajectory(0.3, 0.2, 3)};
  std::unique_ptr<LocalFilter> filter_;
};

// All lengths of the state by one factor.
Eigen::VectorXd GrowthOfInverseLengths(const FilterState& state) {
  Eigen::VectorXd growth = Eigen::VectorXd::Zero(state.dim());
  growth.head<3>() = -state.motion().submap_from_body().translation;
  for (const Landmark& landmark : state.landmarks()) {
    const int row = state.Offset(landmark);
    if (landmark.euclidean) {
      growth.segment<3>(row) = -landmark.point_in_submap;
      continue;
    }
    growth[row + 2] = landmark.inverse_depth;
    if (state.AnchorOffset(landmark) >= 0) {
      growth.segment<3>(state.AnchorOffset(landmark)) = -state.AnchorPosition(landmark);
    }
  }
  return growth;
}

TEST_F(KnownDepthsTest, MeanIsThatOfTheLandmarks) {
  Move(45);
  const MeanDepth mean = MeanOfKnownDepths(filter_->state(), kKnown);
  double sum = 0;
  int count = 0, points = 0;
  for (const LandmarkEstimate& landmark : filter_->Landmarks()) {
    const double distance =
        (landmark.point_in_submap - filter_->submap_from_camera().translation).norm();
    if (landmark.inverse_depth_sigma > kKnown * landmark.inverse_depth) continue;
    sum -= std::log(distance);
    points += landmark.euclidean;
    ++count;
  }
  EXPECT_GT(points, 5);
  EXPECT_GT(count, points) << "some are rays";
  EXPECT_EQ(mean.count, count);
  EXPECT_NEAR(mean.log_inverse_depth, sum / count, 1e-9);
}

TEST_F(KnownDepthsTest, FollowsACommonScale) {
  Move(45);
  const MeanDepth mean = MeanOfKnownDepths(filter_->state(), kKnown);
  EXPECT_NEAR(mean.d_log_d_state.dot(GrowthOfInverseLengths(filter_->state())), 1, 1e-9);
}

TEST_F(KnownDepthsTest, EverySubmapHasAnExactUnit) {
  Move(60);
  const double before = VarianceOfLogMean(kKnown);
  const auto estimates = filter_->Landmarks();
  const Rigid3 camera = filter_->submap_from_camera();
  filter_->BeginSubmap();
  EXPECT_GT(before, 1e-8);
  EXPECT_NEAR(VarianceOfLogMean(kKnown), 0, 1e-12);
  EXPECT_TRUE(filter_->state().IsCovarianceValid());
  const auto after = filter_->Landmarks();
  ASSERT_EQ(after.size(), estimates.size());
  for (size_t i = 0; i < after.size(); ++i) {
    EXPECT_LT((camera * after[i].point_in_submap - estimates[i].point_in_submap).norm(), 1e-9)
        << "the estimate does not change";
  }
}

// A landmark whose prior is independent of the state would tell the scale; this one must not.
TEST_F(KnownDepthsTest, NewLandmarksAreUnknownInUnitsOfTheKnownOnes) {
  Move(60);
  const MeanDepth mean = MeanOfKnownDepths(filter_->state(), kKnown);
  ASSERT_GT(mean.count, 5);
  filter_->RemoveLandmarks(std::vector<TrackId>{filter_->state().landmarks().back().track});
  const MeanDepth left = MeanOfKnownDepths(filter_->state(), kKnown);
  const int old_dim = filter_->state().dim();
  ASSERT_EQ(filter_->AddLandmarks(std::vector<Measurement>{{TrackId(100000), {300, 200}, 0.5}}), 1);
  const FilterState& state = filter_->state();
  const Landmark& added = state.landmarks().back();
  EXPECT_NEAR(std::log(added.inverse_depth), left.log_inverse_depth, 1e-9);
  // Of log(new) - mean of logs: the prior alone, nothing of the state's errors.
  Eigen::RowVectorXd difference = Eigen::RowVectorXd::Zero(state.dim());
  difference.head(old_dim) = -left.d_log_d_state;
  difference[state.Offset(added) + 2] += 1 / added.inverse_depth;
  const double variance = difference * state.covariance() * difference.transpose();
  const double ratio = FilterOptions().relative_inverse_depth_sigma_ratio;
  EXPECT_NEAR(variance, ratio * ratio, 1e-9);
  const Eigen::VectorXd covariances = state.covariance().topRows(old_dim) * difference.transpose();
  EXPECT_LT(covariances.cwiseAbs().maxCoeff(), 1e-9);
}

}  // namespace
}  // namespace portolan
