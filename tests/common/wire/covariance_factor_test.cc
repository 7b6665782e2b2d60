#include "common/wire/covariance_factor.h"

#include <Eigen/Eigenvalues>
#include <limits>
#include <random>

#include "tests/support/matchers.h"

namespace portolan {
namespace {

Matrix6d RandomCovariance(std::mt19937* random, int rank) {
  std::normal_distribution<double> normal;
  Eigen::MatrixXd root(6, rank);
  for (int i = 0; i < root.size(); ++i) root(i) = normal(*random);
  return root * root.transpose();
}

TEST(CovarianceFactor, ReproducesTheCovariance) {
  std::mt19937 random(5);
  const Matrix6d covariance = RandomCovariance(&random, 6);
  const auto factor = CovarianceFactor<6>(covariance);
  ASSERT_TRUE(factor.has_value());
  EXPECT_THAT(*factor * factor->transpose(), NearMatrix(covariance, 1e-12));
}

TEST(CovarianceFactor, AcceptsDirectionsWithoutVariance) {
  EXPECT_EQ(CovarianceFactor<6>(Matrix6d::Zero()), Matrix6d::Zero());
  Matrix6d planar = Matrix6d::Zero();
  planar(0, 0) = 4;
  planar(5, 5) = 1;
  planar(0, 5) = planar(5, 0) = 1;
  const auto factor = CovarianceFactor<6>(planar);
  ASSERT_TRUE(factor.has_value());
  EXPECT_THAT(*factor * factor->transpose(), NearMatrix(planar, 1e-12));
}

TEST(CovarianceFactor, AcceptsSingularCovariances) {
  std::mt19937 random(6);
  for (int rank = 1; rank < 6; ++rank) {
    const Matrix6d covariance = RandomCovariance(&random, rank);
    const auto factor = CovarianceFactor<6>(covariance);
    ASSERT_TRUE(factor.has_value()) << rank;
    EXPECT_THAT(*factor * factor->transpose(), NearMatrix(covariance, 1e-5));
  }
}

TEST(CovarianceFactor, RefusesWhatIsNoCovariance) {
  Eigen::Matrix3d m = Eigen::Matrix3d::Identity();
  m(1, 1) = -1;
  EXPECT_FALSE(CovarianceFactor<3>(m).has_value());
  m = Eigen::Matrix3d::Identity();
  m(0, 1) = m(1, 0) = 1.1;
  EXPECT_FALSE(CovarianceFactor<3>(m).has_value());
  m = Eigen::Matrix3d::Identity();
  m(0, 1) = 0.5;  // asymmetric
  EXPECT_FALSE(CovarianceFactor<3>(m).has_value());
  m = Eigen::Matrix3d::Identity();
  m(2, 2) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(CovarianceFactor<3>(m).has_value());
}

TEST(CovarianceFactor, FloatFactorStaysDefiniteWhereFloatCovarianceDoesNot) {
  // Two almost equal directions: the float32 covariance has lost its definiteness.
  Eigen::Matrix3d m = Eigen::Matrix3d::Identity();
  m(0, 1) = m(1, 0) = 1 - 1e-9;
  const auto factor = CovarianceFactor<3>(m);
  ASSERT_TRUE(factor.has_value());
  const Eigen::Matrix3d rounded = factor->cast<float>().cast<double>();
  EXPECT_GT((rounded * rounded.transpose()).selfadjointView<Eigen::Lower>().eigenvalues()[0], 0);
  const Eigen::Matrix3d directly = m.cast<float>().cast<double>();
  EXPECT_LE(directly.selfadjointView<Eigen::Lower>().eigenvalues()[0], 1e-15);
}

}  // namespace
}  // namespace portolan
