#include "server/refinement/bundle_adjuster.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <atomic>
#include <memory>
#include <random>

#include "common/bundle/bundle_solver.h"
#include "tests/support/test_cameras.h"

namespace portolan {
namespace {

// Cameras side by side before a wall of points, all of it disturbed.
class BundleAdjusterTest : public ::testing::Test {
 protected:
  static constexpr int kCameras = 9;

  BundleAdjusterTest()
      : camera_(
            std::make_shared<const CameraModel>(CameraModel::Create(SubmapTestCamera()).value())) {
    std::mt19937 random(3);
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> uniform(-1, 1);
    for (int i = 0; i < kCameras; ++i) {
      BundleCamera camera;
      camera.model = camera_.get();
      camera.world_from_camera = {RotationExp({0, 0.03 * i, 0.01 * i}),
                                  {0.15 * i, 0.02 * i * i, -0.05 * i}};
      truth_.push_back(camera.world_from_camera);
      problem_.cameras.push_back(camera);
    }
    while (problem_.points.size() < 120) AddPoint(&random);
    problem_.cameras[0].fixed = true;
    for (int i = 1; i < kCameras; ++i) {
      Rigid3& pose = problem_.cameras[i].world_from_camera;
      pose.rotation = pose.rotation * RotationExp({0.01 * normal(random), 0.01 * normal(random),
                                                   0.01 * normal(random)});
      pose.translation += 0.03 * Eigen::Vector3d(uniform(random), uniform(random), uniform(random));
    }
    // Both kinds of priors.
    problem_.cameras[2].prior = PositionPrior{truth_[2].translation, 0.1};
    problem_.distances.push_back(
        {0, kCameras - 1, (truth_[kCameras - 1].translation - truth_[0].translation).norm(), 1e-3});
  }

  void AddPoint(std::mt19937* random) {
    std::uniform_real_distribution<double> uniform(-1, 1);
    std::normal_distribution<double> normal;
    const Eigen::Vector3d point(0.6 + 1.5 * uniform(*random), uniform(*random),
                                4 + uniform(*random));
    const int index = static_cast<int>(problem_.points.size());
    std::vector<BundleObservation> observations;
    for (int i = 0; i < kCameras; ++i) {
      const auto pixel = camera_->Project(truth_[i].Inverse() * point);
      if (!pixel || !camera_->IsInImage(*pixel)) continue;
      BundleObservation observation{i, index, *pixel, 0.7, true};
      observation.pixel += 0.7 * Eigen::Vector2d(normal(*random), normal(*random));
      // One in twenty is wrong.
      if (uniform(*random) > 0.9) observation.pixel.x() += 25;
      observations.push_back(observation);
    }
    if (observations.size() < 2) return;
    problem_.observations.insert(problem_.observations.end(), observations.begin(),
                                 observations.end());
    problem_.points.push_back(
        {point + 0.1 * Eigen::Vector3d(normal(*random), normal(*random), normal(*random)), false});
  }

  double LargestError(const BundleProblem& problem) const {
    double largest = 0;
    for (int i = 0; i < kCameras; ++i) {
      largest = std::max(
          largest,
          (problem.cameras[i].world_from_camera.translation - truth_[i].translation).norm());
    }
    return largest;
  }

  enum class Kind { kDense, kSparse, kCeres };

  static BundleOptions Exact(Kind kind) {
    BundleOptions options;
    options.max_iterations = 200;
    options.function_tolerance = 1e-14;
    options.max_dense_cameras = kind == Kind::kDense ? 1000 : 0;
    options.max_block_cameras = kind == Kind::kCeres ? 0 : 1000;
    return options;
  }

  std::shared_ptr<const CameraModel> camera_;
  std::vector<Rigid3> truth_;
  BundleProblem problem_;
};

TEST_F(BundleAdjusterTest, RecoversTheCameras) {
  EXPECT_GT(LargestError(problem_), 0.02);
  const BundleSummary summary = AdjustBundle({}, nullptr, &problem_);
  EXPECT_TRUE(summary.usable);
  EXPECT_LT(LargestError(problem_), 0.01);
  EXPECT_NEAR(summary.rms_px, 0.7 * std::sqrt(2.0), 0.15);
  EXPECT_EQ(problem_.cameras[0].world_from_camera.translation, truth_[0].translation);
  int outliers = 0;
  for (const BundleObservation& observation : problem_.observations) {
    outliers += observation.inlier ? 0 : 1;
  }
  EXPECT_NEAR(outliers, 0.05 * static_cast<double>(problem_.observations.size()), 15);
}

// All minimise one cost, of one robust loss, from one start.
TEST_F(BundleAdjusterTest, SolversAgree) {
  BundleProblem ceres = problem_;
  const BundleSummary of_ceres = AdjustBundle(Exact(Kind::kCeres), nullptr, &ceres);
  for (const Kind kind : {Kind::kDense, Kind::kSparse}) {
    BundleProblem own = problem_;
    const BundleSummary of_own = AdjustBundle(Exact(kind), nullptr, &own);
    EXPECT_NEAR(of_own.initial_cost, of_ceres.initial_cost, 1e-9 * of_ceres.initial_cost);
    EXPECT_NEAR(of_own.final_cost, of_ceres.final_cost, 1e-6 * of_ceres.final_cost);
    EXPECT_EQ(of_own.inlier_count, of_ceres.inlier_count);
    for (int i = 0; i < kCameras; ++i) {
      EXPECT_LT((own.cameras[i].world_from_camera.translation -
                 ceres.cameras[i].world_from_camera.translation)
                    .norm(),
                1e-5);
    }
  }
}

TEST_F(BundleAdjusterTest, SolversAgreeOnGemanMcClure) {
  BundleProblem ceres = problem_;
  BundleOptions options = Exact(Kind::kCeres);
  options.rounds = 1;
  options.loss = RobustLoss::kGemanMcClure;
  // Wide, so that all find the same minimum.
  options.loss_scale_sigmas = 20;
  const BundleSummary of_ceres = AdjustBundle(options, nullptr, &ceres);
  for (const Kind kind : {Kind::kDense, Kind::kSparse}) {
    BundleProblem own = problem_;
    options.max_dense_cameras = Exact(kind).max_dense_cameras;
    options.max_block_cameras = Exact(kind).max_block_cameras;
    const BundleSummary of_own = AdjustBundle(options, nullptr, &own);
    EXPECT_NEAR(of_own.initial_cost, of_ceres.initial_cost, 1e-9 * of_ceres.initial_cost);
    EXPECT_NEAR(of_own.final_cost, of_ceres.final_cost, 1e-6 * of_ceres.final_cost);
    EXPECT_LT(of_own.final_cost, 0.5 * of_own.initial_cost);
  }
}

// One observation in twenty is wrong by 25 px. Were they four times as wrong the cameras would be
// about where they are; with Cauchy's loss they would not.
TEST_F(BundleAdjusterTest, GemanMcClureIgnoresFarOutliers) {
  const auto shift = [this](RobustLoss loss) {
    BundleOptions options = Exact(Kind::kDense);
    options.rounds = 1;
    options.loss = loss;
    AdjustBundle(options, nullptr, &problem_);  // to the minimum
    BundleProblem near = problem_, far = problem_;
    for (BundleObservation& observation : near.observations) observation.inlier = true;
    far.observations = near.observations;
    for (BundleObservation& observation : far.observations) {
      if (ReprojectionChi2(problem_, observation) > 100) observation.pixel.x() += 75;
    }
    AdjustBundle(options, nullptr, &near);
    AdjustBundle(options, nullptr, &far);
    double largest = 0;
    for (int i = 0; i < kCameras; ++i) {
      largest = std::max(largest, (near.cameras[i].world_from_camera.translation -
                                   far.cameras[i].world_from_camera.translation)
                                      .norm());
    }
    return largest;
  };
  const double cauchy = shift(RobustLoss::kCauchy);
  const double geman_mcclure = shift(RobustLoss::kGemanMcClure);
  EXPECT_LT(geman_mcclure, 0.2 * cauchy);
}

TEST_F(BundleAdjusterTest, HeldPointsAndCamerasStay) {
  for (int i = 0; i < kCameras; i += 2) problem_.cameras[i].fixed = true;
  for (size_t i = 0; i < problem_.points.size(); i += 3) problem_.points[i].fixed = true;
  BundleProblem ceres = problem_;
  const BundleSummary of_ceres = AdjustBundle(Exact(Kind::kCeres), nullptr, &ceres);
  for (const Kind kind : {Kind::kDense, Kind::kSparse}) {
    BundleProblem own = problem_;
    const BundleSummary of_own = AdjustBundle(Exact(kind), nullptr, &own);
    EXPECT_NEAR(of_own.final_cost, of_ceres.final_cost, 1e-6 * of_ceres.final_cost);
    for (int i = 0; i < kCameras; i += 2) {
      EXPECT_EQ(own.cameras[i].world_from_camera.translation,
                problem_.cameras[i].world_from_camera.translation);
    }
    for (size_t i = 0; i < problem_.points.size(); i += 3) {
      EXPECT_EQ(own.points[i].point_in_world, problem_.points[i].point_in_world);
    }
  }
}

// The pixels are those of camera_; the problem is told a lens that is 12 px off at the corners.
class LensTest : public BundleAdjusterTest {
 protected:
  LensTest() {
    const auto wrong = camera_->WithRadial({-0.06, 0.03});
    nominal_ = std::make_shared<const CameraModel>(wrong.value());
    for (BundleCamera& camera : problem_.cameras) camera.model = nominal_.get();
  }

  void FreeLens() {
    problem_.lenses.push_back(MakeLens(nominal_, *nominal_, 5.0));
    for (BundleCamera& camera : problem_.cameras) camera.lens = 0;
  }

  double CornerErrorPx(const CameraModel& model) const {
    const Eigen::Vector2d corner(camera_->width_px() - 1, camera_->height_px() - 1);
    return (*model.Project(*camera_->Unproject(corner)) - corner).norm();
  }

  std::shared_ptr<const CameraModel> nominal_;
};

TEST_F(LensTest, IsFoundWithTheCameras) {
  BundleProblem held = problem_;
  AdjustBundle({}, nullptr, &held);
  FreeLens();
  ASSERT_TRUE(AdjustBundle({}, nullptr, &problem_).usable);
  EXPECT_EQ(problem_.cameras[0].model, problem_.lenses[0].model.get());
  EXPECT_LT(CornerErrorPx(*problem_.lenses[0].model), 0.5 * CornerErrorPx(*nominal_));
  EXPECT_LT(LargestError(problem_), 0.5 * LargestError(held));
}

TEST_F(LensTest, DenseAndSparseSolversAgree) {
  FreeLens();
  BundleProblem dense = problem_, sparse = problem_;
  const BundleSummary of_dense = AdjustBundle(Exact(Kind::kDense), nullptr, &dense);
  const BundleSummary of_sparse = AdjustBundle(Exact(Kind::kSparse), nullptr, &sparse);
  EXPECT_NEAR(of_dense.final_cost, of_sparse.final_cost, 1e-6 * of_dense.final_cost);
  EXPECT_LT((dense.lenses[0].deviation - sparse.lenses[0].deviation).norm(), 1e-5);
}

// A lens that the prior holds firmly is as good as none.
TEST_F(LensTest, FirmPriorHoldsIt) {
  BundleProblem held = problem_;
  const BundleSummary of_held = AdjustBundle(Exact(Kind::kDense), nullptr, &held);
  FreeLens();
  problem_.lenses[0].sqrt_information *= 1e6;
  const BundleSummary summary = AdjustBundle(Exact(Kind::kDense), nullptr, &problem_);
  EXPECT_NEAR(summary.final_cost, of_held.final_cost, 1e-4 * of_held.final_cost);
  EXPECT_LT(problem_.lenses[0].deviation.norm(), 1e-6);
}

TEST_F(LensTest, CovarianceIsThatOfTheDeviation) {
  FreeLens();
  ASSERT_TRUE(AdjustBundle({}, nullptr, &problem_).usable);
  const auto covariance = LensCovariance({}, problem_, 0);
  ASSERT_TRUE(covariance);
  EXPECT_NEAR((*covariance)(0, 1), (*covariance)(1, 0), 1e-6 * covariance->norm());
  const LensVector error = problem_.lenses[0].deviation - LensVector(0.06, -0.03, 0);
  // 99.9 % of chi-square with two degrees of freedom.
  EXPECT_LT(error.dot(covariance->inverse() * error), 13.8);
  const LensMatrix prior =
      (problem_.lenses[0].sqrt_information.transpose() * problem_.lenses[0].sqrt_information)
          .inverse();
  EXPECT_LT(covariance->trace(), 0.5 * prior.trace());
}

TEST_F(BundleAdjusterTest, InterruptedAtOnceMovesNothing) {
  const std::atomic<bool> interrupt = true;
  const BundleProblem before = problem_;
  EXPECT_TRUE(AdjustBundle({}, &interrupt, &problem_).interrupted);
  for (int i = 0; i < kCameras; ++i) {
    EXPECT_LT((problem_.cameras[i].world_from_camera.translation -
               before.cameras[i].world_from_camera.translation)
                  .norm(),
              1e-12);
  }
}

TEST_F(BundleAdjusterTest, NothingToAdjustIsNotUsable) {
  BundleProblem empty;
  EXPECT_FALSE(AdjustBundle({}, nullptr, &empty).usable);
}

}  // namespace
}  // namespace portolan
