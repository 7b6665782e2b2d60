#include "server/refinement/bundle_covariance.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <random>

#include "server/refinement/bundle_adjuster.h"
#include "tests/support/test_cameras.h"

namespace portolan {
namespace {

class BundleCovarianceTest : public ::testing::Test {
 protected:
  // Cameras along x over a field of points; exact, or with pixel noise of sigma.
  BundleProblem MakeProblem(double sigma, uint32_t seed) const {
    std::mt19937 random(seed);
    std::normal_distribution<double> normal(0, 1);
    BundleProblem problem;
    for (int i = 0; i < 4; ++i) {
      BundleCamera camera;
      camera.world_from_camera = {RotationExp({0.02 * i, -0.03 * i, 0.01 * i}), {0.2 * i, 0, 0}};
      camera.model = &camera_;
      camera.fixed = i == 0;
      problem.cameras.push_back(camera);
    }
    for (int i = 0; i < 25; ++i) {
      BundlePoint point;
      point.point_in_world = {0.4 * (i % 5) - 0.8, 0.3 * (i / 5) - 0.6, 3.0 + 0.2 * (i % 3)};
      for (int k = 0; k < 4; ++k) {
        const auto pixel =
            camera_.Project(problem.cameras[k].world_from_camera.Inverse() * point.point_in_world);
        BundleObservation observation{k, i, *pixel, 1.0, true};
        if (sigma > 0) observation.pixel += sigma * Eigen::Vector2d(normal(random), normal(random));
        problem.observations.push_back(observation);
      }
      problem.points.push_back(point);
    }
    return problem;
  }

  const CameraModel camera_ = PinholeTestCamera();
};

TEST_F(BundleCovarianceTest, BlocksOfTheJointAreTheMarginals) {
  const BundleProblem problem = MakeProblem(0, 1);
  const auto covariance = BundleCovariance::Compute(problem);
  ASSERT_TRUE(covariance);
  const Eigen::MatrixXd joint = covariance->Joint({3, 7}, 2);
  ASSERT_EQ(joint.rows(), 12);
  EXPECT_LT((joint.block<3, 3>(0, 0) - covariance->Point(3)).norm(), 1e-12);
  EXPECT_LT((joint.block<3, 3>(3, 3) - covariance->Point(7)).norm(), 1e-12);
  EXPECT_LT((joint.block<6, 6>(6, 6) - covariance->Camera(2)).norm(), 1e-12);
  EXPECT_EQ(Eigen::LLT<Eigen::MatrixXd>(joint).info(), Eigen::Success);
  EXPECT_EQ(covariance->Camera(0).norm(), 0);
}

TEST_F(BundleCovarianceTest, PredictsTheSpreadOfAdjustedPoints) {
  const BundleProblem truth = MakeProblem(0, 1);
  const auto covariance = BundleCovariance::Compute(truth);
  ASSERT_TRUE(covariance);
  BundleOptions options;
  options.rounds = 1;
  options.function_tolerance = 1e-9;
  options.loss_scale_sigmas = 100;
  options.inverse_depth_prior_relative = 100;
  const int runs = 600;
  double point_nees = 0;
  double camera_nees = 0;
  for (int run = 0; run < runs; ++run) {
    BundleProblem problem = MakeProblem(1.0, 10 + run);
    ASSERT_TRUE(AdjustBundle(options, nullptr, &problem).usable);
    // The covariance's gauge: the norm of all positions.
    double estimated = 0, expected = 0;
    for (int k = 1; k < 4; ++k) {
      estimated += truth.cameras[k].world_from_camera.translation.dot(
          problem.cameras[k].world_from_camera.translation);
      expected += truth.cameras[k].world_from_camera.translation.squaredNorm();
    }
    const double scale = expected / estimated;
    const Eigen::Vector3d error =
        scale * problem.points[6].point_in_world - truth.points[6].point_in_world;
    point_nees += error.dot(covariance->Point(6).inverse() * error);
    const Rigid3& pose = truth.cameras[3].world_from_camera;
    Rigid3 scaled = problem.cameras[3].world_from_camera;
    scaled.translation *= scale;
    const Vector6d d = (pose.Inverse() * scaled).Log();
    camera_nees +=
        d.tail<3>().dot(covariance->Camera(3).bottomRightCorner<3, 3>().inverse() * d.tail<3>());
  }
  // Wide: the mean of 600 draws of chi-square with 3 degrees of freedom lies in 2.8 to 3.2.
  EXPECT_GT(point_nees / runs, 2.4);
  EXPECT_LT(point_nees / runs, 3.7);
  EXPECT_GT(camera_nees / runs, 2.4);
  EXPECT_LT(camera_nees / runs, 3.7);
}

TEST_F(BundleCovarianceTest, UndeterminedCameraGivesNothing) {
  BundleProblem problem = MakeProblem(0, 1);
  for (BundleObservation& observation : problem.observations) {
    if (observation.camera == 2) observation.inlier = false;
  }
  EXPECT_FALSE(BundleCovariance::Compute(problem));
}

TEST_F(BundleCovarianceTest, AllCamerasFixedGivesTheConditionalCovariance) {
  BundleProblem problem = MakeProblem(0, 1);
  const Eigen::Matrix3d marginal = BundleCovariance::Compute(problem)->Point(3);
  for (BundleCamera& camera : problem.cameras) camera.fixed = true;
  const Eigen::Matrix3d conditional = BundleCovariance::Compute(problem)->Point(3);
  EXPECT_GT(conditional.determinant(), 0);
  EXPECT_LT(conditional.trace(), marginal.trace());
}

}  // namespace
}  // namespace portolan
