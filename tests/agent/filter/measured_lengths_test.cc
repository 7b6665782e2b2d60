// Lengths that a sensor measures: their derivatives, the update, and the change of the unit.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "agent/filter/known_depths.h"
#include "agent/filter/local_filter.h"
#include "tests/agent/filter/point_world.h"
#include "tests/support/matchers.h"

namespace portolan {
namespace {

// A filter that has moved for a while, so that it has rays, points and anchors.
class MeasuredLengthsTest : public testing::Test {
 protected:
  MeasuredLengthsTest() {
    FilterOptions options;
    options.start.enabled = false;
    options.linearity_threshold = 0.1;
    filter_ = LocalFilter::Create(options, MakeTestCamera(), nullptr).value();
    world_.Start(filter_.get());
    for (int i = 0; i < 45; ++i) world_.Step(filter_.get());
  }

  const FilterState& state() const { return filter_->state(); }

  PointWorld world_{{}, MakeTestCamera(), SwayingTrajectory(0.3, 0.2, 3)};
  std::unique_ptr<LocalFilter> filter_;
};

TEST_F(MeasuredLengthsTest, TheScalesDerivativeIsThatOfACommonGrowth) {
  // Along a growth of all inverse lengths by one per cent the mean logarithm grows by as much.
  const Eigen::RowVectorXd d_scale = *filter_->DScaleDState();
  Eigen::VectorXd growth = Eigen::VectorXd::Zero(state().dim());
  ASSERT_TRUE(state().motion().FillScaleDirection(growth.head(state().motion_dim())));
  const auto before = filter_->Landmarks();
  for (size_t i = 0; i < before.size(); ++i) {
    const Landmark& landmark = state().landmarks()[i];
    const int row = state().Offset(landmark);
    if (landmark.euclidean) {
      growth.segment<3>(row) = -landmark.point_in_submap;
    } else {
      growth[row + 2] = landmark.inverse_depth;
      const int anchor = state().AnchorOffset(landmark);
      if (anchor >= 0) growth.segment<3>(anchor) = -state().AnchorPosition(landmark);
    }
  }
  EXPECT_NEAR(d_scale * growth, 1, 1e-9);
}

TEST_F(MeasuredLengthsTest, AnUpdateIsTheTextbooks) {
  const Eigen::RowVectorXd row = *filter_->DScaleDState();
  const Eigen::MatrixXd p = state().covariance();
  const double log_depth = MeanOfKnownDepths(state(), 0.25).log_inverse_depth;
  const double s = (row * p * row.transpose()).value() + 1e-4;
  EXPECT_TRUE(filter_->UpdateWithLength({row, 0.01, 1e-4}, 9));
  const Eigen::MatrixXd expected = p - p * row.transpose() * row * p / s;
  EXPECT_THAT(Eigen::MatrixXd(state().covariance()), NearMatrix(expected, 1e-12));
  EXPECT_TRUE(state().IsCovarianceValid());
  // Inverse lengths grow by what the measurement is worth.
  EXPECT_NEAR(MeanOfKnownDepths(state(), 0.25).log_inverse_depth - log_depth, (1 - 1e-4 / s) * 0.01,
              5e-4);
}

TEST_F(MeasuredLengthsTest, AWrongLengthIsNotTaken) {
  const Eigen::RowVectorXd row = *filter_->DScaleDState();
  const Eigen::MatrixXd p = state().covariance();
  const double s = (row * p * row.transpose()).value() + 1e-4;
  EXPECT_FALSE(filter_->UpdateWithLength({row, std::nan(""), 1e-4}, 9));
  EXPECT_FALSE(filter_->UpdateWithLength({row, 1e-3, std::nan("")}, 9));
  EXPECT_FALSE(filter_->UpdateWithLength({0 * row, 1e-3, 0}, 9));
  EXPECT_FALSE(filter_->UpdateWithLength({row, 3.01 * std::sqrt(s), 1e-4}, 9));
  EXPECT_EQ((state().covariance() - p).norm(), 0);
  EXPECT_TRUE(filter_->UpdateWithLength({row, 2.99 * std::sqrt(s), 1e-4}, 9));
}

TEST_F(MeasuredLengthsTest, AScaleMultipliesAllLengthsAndMovesNoPixel) {
  const auto before = filter_->Landmarks();
  const auto pixels = filter_->PredictMeasurements();
  const Rigid3 camera = filter_->submap_from_camera();
  const Eigen::Vector3d velocity = filter_->linear_velocity();
  const double depth = filter_->median_inverse_depth();
  const Timestamp time = filter_->time();
  ASSERT_TRUE(filter_->TakeScale(2.5));
  EXPECT_TRUE(filter_->metric());
  EXPECT_EQ(filter_->time(), time);
  EXPECT_TRUE(state().IsCovarianceValid());
  EXPECT_THAT(filter_->submap_from_camera().translation,
              NearMatrix(2.5 * camera.translation, 1e-12));
  EXPECT_EQ(filter_->submap_from_camera().rotation.coeffs(), camera.rotation.coeffs());
  EXPECT_THAT(filter_->linear_velocity(), NearMatrix(2.5 * velocity, 1e-12));
  EXPECT_NEAR(filter_->median_inverse_depth(), depth / 2.5, 1e-12);
  const auto after = filter_->Landmarks();
  ASSERT_EQ(after.size(), before.size());
  for (size_t i = 0; i < after.size(); ++i) {
    EXPECT_NEAR(after[i].inverse_depth, before[i].inverse_depth / 2.5, 1e-12);
  }
  const auto moved = filter_->PredictMeasurements();
  ASSERT_EQ(moved.size(), pixels.size());
  for (size_t i = 0; i < moved.size(); ++i) {
    EXPECT_THAT(moved[i].pixel, NearMatrix(pixels[i].pixel, 1e-9));
  }
  // The metre is exact for the filter.
  const Eigen::RowVectorXd d_scale = *filter_->DScaleDState();
  EXPECT_LT((d_scale * state().covariance() * d_scale.transpose()).value(), 1e-12);
  // It goes on.
  for (int i = 0; i < 5; ++i) {
    world_.Advance();
    filter_->Predict(world_.time());
    EXPECT_GT(filter_->Update(world_.Measure(*filter_)).inliers.size(), 20u);
  }
}

TEST_F(MeasuredLengthsTest, AStartForgetsTheScale) {
  ASSERT_TRUE(filter_->TakeScale(3));
  filter_->Start(world_.time());
  EXPECT_FALSE(filter_->has_scale());
  EXPECT_FALSE(filter_->metric());
}

TEST_F(MeasuredLengthsTest, MetresThatAnotherSensorTellsStay) {
  filter_->TakeMetricDepths(1);
  EXPECT_FALSE(filter_->TakeScale(3));
  EXPECT_TRUE(filter_->metric());
}

TEST_F(MeasuredLengthsTest, TrustCanBeTakenBack) {
  ASSERT_TRUE(filter_->TakeScale(3));
  filter_->TrustScale(false);
  EXPECT_FALSE(filter_->metric());
  EXPECT_TRUE(filter_->has_scale());
  filter_->TrustScale(true);
  EXPECT_TRUE(filter_->metric());
}

// A model whose own sensor tells lengths, which none may overrule.
class MeasuringModel : public ConstantVelocityModel {
 public:
  using ConstantVelocityModel::ConstantVelocityModel;
  bool FillScaleDirection(Eigen::Ref<Eigen::VectorXd>) const override { return false; }
  std::unique_ptr<MotionModel> Rescaled(double, Eigen::VectorXd*) const override { return nullptr; }
};

TEST(MeasuredLengths, AMotionModelThatTellsTheScaleKeepsIt) {
  FilterOptions options;
  options.start.enabled = false;
  auto filter = LocalFilter::Create(options, MakeTestCamera(),
                                    std::make_unique<MeasuringModel>(ConstantVelocityOptions{}))
                    .value();
  PointWorld world({}, MakeTestCamera(), SwayingTrajectory(0.3, 0.2, 3));
  world.Start(filter.get());
  for (int i = 0; i < 30; ++i) world.Step(filter.get());
  const Eigen::MatrixXd p = filter->state().covariance();
  EXPECT_FALSE(filter->TakeScale(2));
  EXPECT_EQ((filter->state().covariance() - p).norm(), 0);
}

}  // namespace
}  // namespace portolan
