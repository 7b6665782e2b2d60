#include "agent/landmarks/triangulation.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "agent/landmarks/two_view_geometry.h"
#include "common/base/check.h"
#include "tests/support/matchers.h"
#include "tests/support/numeric_derivative.h"

namespace portolan {
namespace {

constexpr double kSigmaRad = 0.002;

Eigen::Vector3d RandomVector(std::mt19937_64* random, double range) {
  std::uniform_real_distribution<double> uniform(-range, range);
  const double x = uniform(*random), y = uniform(*random);
  return {x, y, uniform(*random)};
}

Eigen::Vector3d Noisy(const Eigen::Vector3d& direction, double sigma_rad, std::mt19937_64* random) {
  std::normal_distribution<double> noise(0, sigma_rad);
  const Eigen::Vector3d unit = direction.normalized();
  const Eigen::Vector3d a = unit.unitOrthogonal(), b = unit.cross(a);
  const double x = noise(*random), y = noise(*random);
  return (unit + x * a + y * b).normalized();
}

// A point in front of the reference camera, and cameras that moved a little from it.
struct Problem {
  Eigen::Vector3d point_in_reference;
  Eigen::Vector3d bearing;
  std::vector<BearingView> views;
};

Problem RandomProblem(int views, double noise_rad, std::mt19937_64* random) {
  Problem problem;
  problem.point_in_reference = Eigen::Vector3d(0, 0, 4) + RandomVector(random, 1.0);
  problem.bearing = Noisy(problem.point_in_reference, noise_rad, random);
  for (int i = 0; i < views; ++i) {
    BearingView view;
    view.camera_from_reference = {RotationExp(RandomVector(random, 0.2)),
                                  (i + 1.0) / views * Eigen::Vector3d(0.5, 0.1, 0.05)};
    view.bearing =
        Noisy(view.camera_from_reference * problem.point_in_reference, noise_rad, random);
    problem.views.push_back(view);
  }
  return problem;
}

TEST(BearingResidual, JacobianIsTheNumericOne) {
  std::mt19937_64 random(3);
  for (int i = 0; i < 50; ++i) {
    const Problem problem = RandomProblem(1, 0.02, &random);
    InverseDepthPoint point = MakeInverseDepthPoint(problem.bearing, 0.3);
    point.value.head<2>() = RandomVector(&random, 0.05).head<2>();
    const auto residual = ResidualOf(problem.views[0], point);
    ASSERT_TRUE(residual.has_value());
    const auto numeric = NumericJacobianAtZero(
        3,
        [&](const Eigen::VectorXd& e) {
          InverseDepthPoint moved = point;
          moved.value += e;
          return ResidualOf(problem.views[0], moved)->value;
        },
        1e-5);
    EXPECT_THAT(residual->d_point, NearMatrix(numeric, 1e-8));
  }
}

TEST(Triangulation, LinearOneIsExactWithoutNoise) {
  std::mt19937_64 random(4);
  for (int i = 0; i < 50; ++i) {
    const Problem problem = RandomProblem(1, 0, &random);
    const auto inverse_depth = InverseDepthByDlt(problem.bearing, problem.views[0]);
    ASSERT_TRUE(inverse_depth.has_value());
    EXPECT_NEAR(*inverse_depth * problem.point_in_reference.norm(), 1, 1e-9);
  }
}

TEST(Triangulation, RefusesPointsBehindAndNoBaseline) {
  BearingView view{{Eigen::Quaterniond::Identity(), {0.5, 0, 0}}, {0, 0, 1}};
  // The rays part: they meet behind the cameras.
  EXPECT_FALSE(InverseDepthByDlt(Eigen::Vector3d(0.1, 0, 1).normalized(), view).has_value());
  view.camera_from_reference.translation.setZero();
  EXPECT_FALSE(InverseDepthByDlt(Eigen::Vector3d(0, 0, 1), view).has_value());
  EXPECT_FALSE(InverseDepthSigma(MakeInverseDepthPoint({0, 0, 1}, 0.5), {&view, 1}, 0.01));
}

// Root mean square of (estimate - truth) / sigma and of the error, for both methods.
struct Accuracy {
  double dlt_error = 0, lm_error = 0, dlt_normalised = 0, lm_normalised = 0;
};

Accuracy MonteCarlo(int views, int runs) {
  std::mt19937_64 random(5);
  Accuracy sum;
  for (int i = 0; i < runs; ++i) {
    const Problem p = RandomProblem(views, kSigmaRad, &random);
    const double truth = 1 / p.point_in_reference.norm();
    const auto dlt = InverseDepthByDlt(p.bearing, p.views.back());
    const auto sigma =
        InverseDepthSigma(MakeInverseDepthPoint(p.bearing, *dlt), {&p.views.back(), 1}, kSigmaRad);
    const auto lm = InverseDepthByLevenbergMarquardt(p.bearing, *dlt, p.views, kSigmaRad);
    PORTOLAN_CHECK(lm.has_value());
    sum.dlt_error += std::pow(*dlt - truth, 2);
    sum.lm_error += std::pow(lm->inverse_depth - truth, 2);
    sum.dlt_normalised += std::pow((*dlt - truth) / *sigma, 2) / runs;
    sum.lm_normalised += std::pow((lm->inverse_depth - truth) / lm->sigma, 2) / runs;
  }
  return sum;
}

TEST(Triangulation, SigmasAreHonest) {
  const Accuracy accuracy = MonteCarlo(8, 2000);
  EXPECT_NEAR(accuracy.dlt_normalised, 1, 0.12);
  EXPECT_NEAR(accuracy.lm_normalised, 1, 0.12);
}

TEST(Triangulation, ManyViewsBeatTwo) {
  const Accuracy accuracy = MonteCarlo(8, 2000);
  EXPECT_LT(accuracy.lm_error, 0.8 * accuracy.dlt_error);
}

TEST(Triangulation, LevenbergMarquardtConvergesFromAFarStart) {
  std::mt19937_64 random(6);
  for (int i = 0; i < 50; ++i) {
    const Problem p = RandomProblem(5, 0, &random);
    const double truth = 1 / p.point_in_reference.norm();
    const auto found =
        InverseDepthByLevenbergMarquardt(p.bearing, i % 2 ? 3 * truth : 0.2 * truth, p.views, 0.01);
    ASSERT_TRUE(found.has_value());
    EXPECT_NEAR(found->inverse_depth / truth, 1, 1e-4);
  }
}

std::vector<BearingPair> PairsOf(const Rigid3& second_from_first, int count, double outlier_share) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<BearingPair> pairs;
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector3d point = Eigen::Vector3d(0, 0, 4) + RandomVector(&random, 1.5);
    BearingPair pair{Noisy(point, 0.001, &random),
                     Noisy(second_from_first * point, 0.001, &random)};
    if (uniform(random) < outlier_share) {
      pair.in_second = Noisy(Eigen::Vector3d::UnitZ(), 0.3, &random);
    }
    pairs.push_back(pair);
  }
  return pairs;
}

TEST(EpipolarResidual, JacobianIsTheNumericOne) {
  std::mt19937_64 random(8);
  for (int i = 0; i < 30; ++i) {
    const Rigid3 pose = {RotationExp(RandomVector(&random, 0.5)), RandomVector(&random, 1)};
    const BearingPair pair{Noisy(RandomVector(&random, 1), 0, &random),
                           Noisy(RandomVector(&random, 1), 0, &random)};
    const EpipolarResidual residual = EpipolarResidualOf(pose, pair);
    const auto numeric = NumericJacobianAtZero(6, [&](const Eigen::VectorXd& e) {
      const Rigid3 moved = {pose.rotation * RotationExp(e.head<3>()),
                            pose.translation + e.tail<3>()};
      return Eigen::Matrix<double, 1, 1>(EpipolarResidualOf(moved, pair).value);
    });
    EXPECT_THAT(residual.d_rotation, NearMatrix(numeric.leftCols(3), 1e-8));
    EXPECT_THAT(residual.d_translation, NearMatrix(numeric.rightCols(3), 1e-8));
  }
}

TEST(PoseOfTwoViews, IsFoundAmongOutliers) {
  const Rigid3 truth = {RotationExp({0.02, -0.1, 0.05}), Eigen::Vector3d(0.6, 0.1, 0.2)};
  const auto found = PoseOfTwoViews(PairsOf(truth, 80, 0.25), 0.001);
  ASSERT_TRUE(found.has_value());
  EXPECT_LT(found->rotation.angularDistance(truth.rotation), 0.01);
  EXPECT_GT(found->translation.dot(truth.translation.normalized()), 0.9995);
  EXPECT_NEAR(found->translation.norm(), 1, 1e-9);
}

TEST(PoseOfTwoViews, NeedsEnoughPairsThatAgree) {
  const Rigid3 pose = {RotationExp({0.02, -0.1, 0.05}), Eigen::Vector3d(0.6, 0.1, 0.2)};
  EXPECT_FALSE(PoseOfTwoViews(PairsOf(pose, 9, 0), 0.001).has_value());
  EXPECT_FALSE(PoseOfTwoViews(PairsOf(pose, 80, 1.0), 0.001).has_value());
  EXPECT_FALSE(PoseOfTwoViews({}, 0.001).has_value());
}

// Any pose fits, or none.
TEST(PoseOfTwoViews, OfOnePointIsNoneOrIsOne) {
  const BearingPair same{{0, 0, 1}, {0, 0, 1}};
  const std::vector<BearingPair> degenerate(30, same);
  const auto found = PoseOfTwoViews(degenerate, 0.001);
  if (!found) return;
  EXPECT_NEAR(found->rotation.norm(), 1, 1e-9);
  EXPECT_NEAR(found->translation.norm(), 1, 1e-9);
}

}  // namespace
}  // namespace portolan
