#include "agent/filter/local_filter.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "tests/agent/filter/point_world.h"
#include "tests/support/matchers.h"

namespace portolan {
namespace {

std::unique_ptr<LocalFilter> MakeFilter(const FilterOptions& options = {}) {
  return LocalFilter::Create(options, MakeTestCamera(), nullptr).value();
}

struct Accuracy {
  double position_rmse = 0;  // after scaling to the truth, over the true path length
  double path = 0;
  int wrong_inliers = 0, missed_inliers = 0, inliers = 0;
};

// Best scale of the estimated positions, which share origin and axes with the true ones.
Accuracy Follow(PointWorld* world, LocalFilter* filter, int frames) {
  Accuracy run;
  std::vector<Eigen::Vector3d> estimated, truth;
  std::vector<Timestamp> times;
  world->Start(filter);
  for (int i = 0; i < frames; ++i) {
    const UpdateResult result = world->Step(filter);
    for (TrackId track : result.inliers) run.wrong_inliers += world->is_outlier(track);
    for (TrackId track : result.outliers) run.missed_inliers += !world->is_outlier(track);
    run.inliers += static_cast<int>(result.inliers.size());
    times.push_back(world->time());
    estimated.push_back(filter->submap_from_camera().translation);
    // A start that was smoothed tells its frames anew.
    for (const auto& [time, pose] : filter->TakeRestatedPoses()) {
      const auto at = std::find(times.begin(), times.end(), time);
      if (at != times.end()) estimated[at - times.begin()] = pose.translation;
    }
    truth.push_back(world->true_submap_from_camera().translation);
  }
  double numerator = 0, denominator = 0, square = 0;
  for (size_t i = 0; i < truth.size(); ++i) {
    numerator += truth[i].dot(estimated[i]);
    denominator += estimated[i].squaredNorm();
    if (i > 0) run.path += (truth[i] - truth[i - 1]).norm();
  }
  for (size_t i = 0; i < truth.size(); ++i) {
    square += (numerator / denominator * estimated[i] - truth[i]).squaredNorm();
  }
  run.position_rmse = std::sqrt(square / truth.size()) / run.path;
  return run;
}

TEST(LocalFilter, RefusesBadOptions) {
  FilterOptions options;
  options.ransac_success_probability = 1;
  const auto filter = LocalFilter::Create(options, MakeTestCamera(), nullptr);
  EXPECT_THAT(filter.status(), StatusIs(absl::StatusCode::kInvalidArgument));
}

TEST(LocalFilter, ConvergesUpToScaleWhenSwaying) {
  const CameraModel camera = MakeTestCamera();
  PointWorld world({}, camera, SwayingTrajectory(0.3, 0.2, 3));
  auto filter = MakeFilter();
  const Accuracy run = Follow(&world, filter.get(), 120);
  EXPECT_LT(run.position_rmse, 0.01);
  EXPECT_FALSE(filter->Diverged());
  EXPECT_LT(filter->WindowNormalisedInnovation(), 1.5);
}

TEST(LocalFilter, ConvergesUpToScaleWhenDriving) {
  PointWorldOptions options;
  options.rate_hz = 10;
  options.landmarks = 50;
  PointWorld world(options, MakeTestCamera(), DrivingTrajectory(0.7, 0.1));
  auto filter = MakeFilter();
  const Accuracy run = Follow(&world, filter.get(), 80);
  EXPECT_LT(run.position_rmse, 0.02);
}

TEST(LocalFilter, ConvertsToPointsOnceDepthIsKnown) {
  PointWorld world({}, MakeTestCamera(), SwayingTrajectory(0.3, 0.2, 3));
  FilterOptions options;
  options.linearity_threshold = 0.1;
  auto filter = MakeFilter(options);
  world.Start(filter.get());
  for (const LandmarkEstimate& l : filter->Landmarks()) EXPECT_FALSE(l.euclidean);
  for (int i = 0; i < 60; ++i) world.Step(filter.get());
  int euclidean = 0;
  for (const LandmarkEstimate& l : filter->Landmarks()) euclidean += l.euclidean;
  EXPECT_GT(euclidean, filter->landmark_count() / 2);
}

TEST(LocalFilter, PureRotationKeepsDepthUnknown) {
  PointWorldOptions options;
  PointWorld world(options, MakeTestCamera(), SwayingTrajectory(0, 0.2, 3));
  auto filter = MakeFilter();
  world.Start(filter.get());
  for (int i = 0; i < 60; ++i) world.Step(filter.get());
  int euclidean = 0;
  for (const LandmarkEstimate& l : filter->Landmarks()) euclidean += l.euclidean;
  EXPECT_EQ(euclidean, 0);
  const Rigid3 truth = world.true_submap_from_camera();
  EXPECT_LT(filter->submap_from_camera().rotation.angularDistance(truth.rotation), 0.008);
}

class Outliers : public testing::TestWithParam<double> {};

TEST_P(Outliers, AreRejected) {
  PointWorldOptions options;
  options.outlier_share = GetParam();
  PointWorld world(options, MakeTestCamera(), SwayingTrajectory(0.3, 0.2, 3));
  auto filter = MakeFilter();
  const Accuracy run = Follow(&world, filter.get(), 90);
  EXPECT_LT(run.position_rmse, 0.015);
  EXPECT_LT(run.wrong_inliers, 0.003 * run.inliers);
  EXPECT_LT(run.missed_inliers, 0.06 * run.inliers);
}

INSTANTIATE_TEST_SUITE_P(Shares, Outliers, testing::Values(0.1, 0.3, 0.5));

// Predicted pixels and H P H' of all landmarks, one row a landmark.
Eigen::MatrixXd Predictions(const LocalFilter& filter) {
  Eigen::MatrixXd rows(filter.landmark_count(), 6);
  for (int i = 0; i < filter.landmark_count(); ++i) {
    const auto linear = Linearise(filter.state(), filter.camera(), {i, {0, 0}, 1.0});
    const Eigen::Matrix2d s = LinearCovariance(filter.state(), *linear);
    rows.row(i) << linear->innovation.transpose(), s.reshaped().transpose();
  }
  return rows;
}

TEST(LocalFilter, HandOverKeepsPredictions) {
  PointWorld world({}, MakeTestCamera(), SwayingTrajectory(0.3, 0.2, 3));
  auto filter = MakeFilter();
  world.Start(filter.get());
  for (int i = 0; i < 25; ++i) world.Step(filter.get());
  const Eigen::MatrixXd before = Predictions(*filter);
  const double speed = filter->linear_velocity().norm();
  const Rigid3 pose = filter->submap_from_camera();
  EXPECT_THAT(filter->BeginSubmap(), NearRigid(pose, 1e-12));
  EXPECT_THAT(Predictions(*filter), NearMatrix(before, 1e-7));
  EXPECT_THAT(filter->submap_from_camera(), NearRigid(Rigid3::Identity(), 1e-12));
  EXPECT_THAT(filter->pose_covariance(), NearMatrix(Matrix6d::Zero().eval(), 1e-15));
  EXPECT_NEAR(filter->linear_velocity().norm(), speed, 1e-12);
  EXPECT_TRUE(filter->state().IsCovarianceValid());
}

// The joint covariance too: what follows after the next motion depends on every block of it.
TEST(LocalFilter, HandOverKeepsPredictionsAfterMotion) {
  std::vector<Eigen::MatrixXd> predictions;
  for (bool cut : {false, true}) {
    PointWorld world({}, MakeTestCamera(), SwayingTrajectory(0.3, 0.2, 3));
    auto filter = MakeFilter();
    world.Start(filter.get());
    for (int i = 0; i < 25; ++i) world.Step(filter.get());
    if (cut) filter->BeginSubmap();
    filter->Predict(FromSeconds(26 / 30.0));
    predictions.push_back(Predictions(*filter));
  }
  EXPECT_THAT(predictions[1], NearMatrix(predictions[0], 1e-6));
}

TEST(LocalFilter, ScaleSurvivesHandOver) {
  PointWorldOptions options;
  PointWorld world(options, MakeTestCamera(), SwayingTrajectory(0.4, 0.3, 3));
  auto filter = MakeFilter();
  world.Start(filter.get());
  const auto scale = [&] {
    std::vector<double> ratios;
    for (const LandmarkEstimate& l : filter->Landmarks()) {
      if (!l.euclidean) continue;
      const Rigid3 truth = world.true_submap_from_camera();
      ratios.push_back((truth.Inverse() * world.true_point_in_submap(l.track)).norm() *
                       l.inverse_depth);
    }
    std::nth_element(ratios.begin(), ratios.begin() + ratios.size() / 2, ratios.end());
    return ratios[ratios.size() / 2];
  };
  for (int i = 0; i < 45; ++i) world.Step(filter.get());
  const double before = scale();
  for (int submap = 0; submap < 3; ++submap) {
    world.BeginSubmap(filter.get());
    for (int i = 0; i < 30; ++i) world.Step(filter.get());
  }
  EXPECT_NEAR(scale() / before, 1, 0.03);
}

TEST(LocalFilter, EqualCallsGiveEqualStates) {
  const auto final_pose = [] {
    PointWorldOptions options;
    options.outlier_share = 0.3;
    PointWorld world(options, MakeTestCamera(), SwayingTrajectory(0.3, 0.2, 3));
    auto filter = MakeFilter();
    Follow(&world, filter.get(), 30);
    return filter->submap_from_camera().Matrix();
  };
  EXPECT_EQ(final_pose(), final_pose());
}

TEST(LocalFilter, WrongWorldIsCalledDiverged) {
  PointWorldOptions options;
  options.outlier_share = 0.9;
  PointWorld world(options, MakeTestCamera(), SwayingTrajectory(0.3, 0.2, 3));
  auto filter = MakeFilter();
  Follow(&world, filter.get(), 20);
  EXPECT_TRUE(filter->Diverged());
  filter->Start(FromSeconds(10));
  EXPECT_FALSE(filter->Diverged());
}

TEST(LocalFilter, SurvivesNonsense) {
  PointWorld world({}, MakeTestCamera(), SwayingTrajectory(0.3, 0.2, 3));
  auto filter = MakeFilter();
  Follow(&world, filter.get(), 10);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const TrackId known = filter->state().landmarks()[0].track;
  const std::vector<Measurement> nonsense = {{TrackId(999999), {1, 2}, 1.0},
                                             {known, {nan, 2}, 1.0},
                                             {filter->state().landmarks()[1].track, {1, 2}, 0.0}};
  EXPECT_FALSE(filter->Predict(filter->time()));
  const UpdateResult result = filter->Update(nonsense);
  EXPECT_TRUE(result.inliers.empty());
  EXPECT_EQ(result.outliers.size(), 3u);
  filter->AddLandmarks(nonsense);
  filter->RemoveLandmarks(std::vector<TrackId>{TrackId(123456)});
  EXPECT_TRUE(filter->state().IsCovarianceValid());
}

}  // namespace
}  // namespace portolan
