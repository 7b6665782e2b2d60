#include "agent/filter/joint_compatibility.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/agent/filter/point_world.h"

namespace portolan {
namespace {

TEST(ChiSquareQuantile, AgreesWithTables) {
  EXPECT_NEAR(ChiSquareQuantile(0.99, 2) / 9.2103, 1, 0.01);
  EXPECT_NEAR(ChiSquareQuantile(0.95, 2) / 5.9915, 1, 0.01);
  EXPECT_NEAR(ChiSquareQuantile(0.99, 10) / 23.209, 1, 0.002);
  EXPECT_NEAR(ChiSquareQuantile(0.95, 100) / 124.342, 1, 0.001);
}

// The matches of one frame of a swaying camera, linearised at the prediction.
class JointSelection : public testing::Test {
 protected:
  JointSelection() : world_({}, camera_, SwayingTrajectory(0.3, 0.2, 3)) {
    filter_ = LocalFilter::Create({}, camera_, nullptr).value();
    world_.Start(filter_.get());
    for (int i = 0; i < 40; ++i) world_.Step(filter_.get());
    world_.Advance();
    filter_->Predict(world_.time());
    for (const Measurement& m : world_.Measure(*filter_)) {
      Add({filter_->state().Find(m.track), m.pixel, 2.0, 0});
    }
  }

  void Add(const Match& match) {
    const auto linear = Linearise(filter_->state(), camera_, match);
    ASSERT_TRUE(linear.has_value());
    matches_.push_back(match);
    linear_.push_back(*linear);
  }
  void Shift(int match, const Eigen::Vector2d& by) {
    matches_[match].pixel += by;
    linear_[match].innovation += by;
  }
  InlierSet Select(const FilterOptions& options) {
    const FilterState& state = filter_->state();
    KalmanUpdate kalman({}, state.max_dim(), static_cast<int>(linear_.size()));
    kalman.ComputePHt(state, linear_);
    JointCompatibility selector(options);
    return selector.Select(matches_, linear_,
                           kalman.pht(state.dim(), static_cast<int>(linear_.size())), state,
                           camera_);
  }
  // v' S^-1 v of a set, with S built from the whole covariance.
  double DenseDistance(const std::vector<int>& set) const {
    const FilterState& state = filter_->state();
    const int rows = 2 * static_cast<int>(set.size());
    Eigen::MatrixXd h = Eigen::MatrixXd::Zero(rows, state.dim());
    Eigen::MatrixXd s = Eigen::MatrixXd::Zero(rows, rows);
    Eigen::VectorXd v(rows);
    for (size_t i = 0; i < set.size(); ++i) {
      const LinearMeasurement& m = linear_[set[i]];
      const auto row = static_cast<long>(2 * i);
      h.block<2, 6>(row, 0) = m.d_pose;
      h.block<2, 3>(row, m.landmark_offset) = m.d_landmark;
      if (m.anchor_offset != FilterState::kFixed) h.block<2, 3>(row, m.anchor_offset) = m.d_anchor;
      s.block<2, 2>(row, row) = DepthShiftCovariance(state, m, ShiftCovariance(state, m));
      s.block<2, 2>(row, row).diagonal().array() += m.variance;
      v.segment<2>(row) = m.innovation;
    }
    s += h * state.covariance() * h.transpose();
    return v.dot(s.llt().solve(v));
  }

  const CameraModel camera_ = MakeTestCamera();
  PointWorld world_;
  std::unique_ptr<LocalFilter> filter_;
  std::vector<Match> matches_;
  std::vector<LinearMeasurement> linear_;
};

TEST_F(JointSelection, TakesAllThatAgreeWithOneDescent) {
  const InlierSet inliers = Select({});
  EXPECT_EQ(inliers.matches.size(), matches_.size());
  EXPECT_EQ(inliers.hypotheses, static_cast<int>(matches_.size()));
}

TEST_F(JointSelection, LeavesOutWhatContradictsTheRest) {
  Shift(3, {25, 0});
  Shift(11, {0, -18});
  const InlierSet inliers = Select({});
  EXPECT_GE(inliers.matches.size(), matches_.size() - 4);
  for (int wrong : {3, 11}) {
    EXPECT_EQ(std::count(inliers.matches.begin(), inliers.matches.end(), wrong), 0);
  }
  EXPECT_TRUE(std::is_sorted(inliers.matches.begin(), inliers.matches.end()));
}

TEST_F(JointSelection, FindsTheLargestCompatibleSetOfASmallProblem) {
  matches_.resize(9);
  linear_.resize(9);
  Shift(0, {9, 4});
  Shift(4, {-7, 5});
  Shift(7, {4, -9});
  FilterOptions options;
  options.joint_max_nodes = 100000;
  const InlierSet found = Select(options);
  int largest = 0;
  for (int mask = 0; mask < 512; ++mask) {
    std::vector<int> set;
    for (int i = 0; i < 9; ++i) {
      if (mask >> i & 1) set.push_back(i);
    }
    const int size = static_cast<int>(set.size());
    if (size <= largest) continue;
    if (DenseDistance(set) < ChiSquareQuantile(options.joint_probability, 2 * size)) largest = size;
  }
  EXPECT_LT(largest, 9);
  EXPECT_EQ(static_cast<int>(found.matches.size()), largest);
  EXPECT_LT(DenseDistance(found.matches),
            ChiSquareQuantile(options.joint_probability, 2 * largest));
}

TEST_F(JointSelection, BoundsItsWork) {
  for (int i = 0; i < 10; ++i) Shift(2 * i, {8.0 - i, i % 3 * 5.0});
  FilterOptions options;
  options.joint_max_nodes = 40;
  EXPECT_LE(Select(options).hypotheses, 40);
}

TEST(JointCompatibility, KeepsTheFilterOnCourseAmongOutliers) {
  FilterOptions options;
  options.inlier_selection = InlierSelection::kJointCompatibility;
  PointWorldOptions world_options;
  world_options.outlier_share = 0.2;
  PointWorld world(world_options, MakeTestCamera(), SwayingTrajectory(0.3, 0.2, 3));
  auto filter = LocalFilter::Create(options, MakeTestCamera(), nullptr).value();
  world.Start(filter.get());
  int wrong = 0, inliers = 0;
  for (int i = 0; i < 60; ++i) {
    for (TrackId track : world.Step(filter.get()).inliers) {
      wrong += world.is_outlier(track);
      ++inliers;
    }
  }
  EXPECT_FALSE(filter->Diverged());
  EXPECT_GT(inliers, 60 * 20);
  EXPECT_LT(wrong, 0.005 * inliers);
}

TEST(JointCompatibility, OptionsAreChecked) {
  FilterOptions options;
  options.joint_probability = 1.0;
  EXPECT_FALSE(options.Validate().ok());
  options = {};
  options.joint_max_nodes = 0;
  EXPECT_FALSE(options.Validate().ok());
}

}  // namespace
}  // namespace portolan
