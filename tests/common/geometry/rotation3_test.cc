#include "common/geometry/rotation3.h"

#include <numbers>

#include "tests/support/matchers.h"
#include "tests/support/numeric_derivative.h"

namespace portolan {
namespace {

using Eigen::Vector3d;

TEST(Rotation3, SkewIsTheCrossProduct) {
  const Vector3d a(1, -2, 3), b(0.5, 4, -1);
  EXPECT_THAT(Skew(a) * b, NearMatrix(a.cross(b), 1e-15));
}

TEST(Rotation3, ExpEqualsAngleAxis) {
  const Vector3d axis = Vector3d(1, 2, -2) / 3;
  for (double angle : {1e-12, 1e-3, 0.009999, 0.010001, 1.0, 3.0, 6.0}) {
    const Eigen::Quaterniond expected(Eigen::AngleAxisd(angle, axis));
    EXPECT_THAT(RotationExp(angle * axis).coeffs(), NearMatrix(expected.coeffs(), 1e-15)) << angle;
  }
}

TEST(Rotation3, LogOfNegatedQuaternionIsTheSameRotation) {
  const Eigen::Quaterniond q = RotationExp(Vector3d(0.3, -0.2, 0.9));
  const Eigen::Quaterniond negated(-q.w(), -q.x(), -q.y(), -q.z());
  EXPECT_THAT(RotationLog(negated), NearMatrix(RotationLog(q), 1e-15));
}

TEST(Rotation3, LogOfHalfTurnHasLengthPi) {
  for (const Vector3d& axis : {Vector3d::UnitX().eval(), Vector3d::UnitY().eval(),
                               Vector3d(Vector3d(1, 1, -1).normalized())}) {
    const Eigen::Quaterniond half_turn(0, axis.x(), axis.y(), axis.z());
    EXPECT_NEAR(RotationLog(half_turn).norm(), std::numbers::pi, 1e-14);
    EXPECT_NEAR(std::abs(RotationLog(half_turn).normalized().dot(axis)), 1, 1e-14);
  }
}

class RightJacobianTest : public testing::TestWithParam<double> {};

TEST_P(RightJacobianTest, EqualsNumericDerivativeOfExp) {
  const Vector3d v = GetParam() * Vector3d(0.6, -0.48, 0.64);
  const Eigen::Quaterniond inverse = RotationExp(v).conjugate();
  const Eigen::MatrixXd numeric = NumericJacobianAtZero(3, [&](const Eigen::VectorXd& d) {
    return RotationLog(inverse * RotationExp(v + Vector3d(d)));
  });
  EXPECT_THAT(RotationRightJacobian(v), NearMatrix(numeric, 1e-10));
}

TEST_P(RightJacobianTest, InverseIsTheInverse) {
  const Vector3d v = GetParam() * Vector3d(0.6, -0.48, 0.64);
  EXPECT_THAT(RotationRightJacobian(v) * RotationRightJacobianInverse(v),
              NearMatrix(Eigen::Matrix3d::Identity(), 1e-9));
}

INSTANTIATE_TEST_SUITE_P(Angles, RightJacobianTest,
                         testing::Values(0.0, 1e-9, 1e-4, 0.00999, 0.01001, 0.3, 1.5, 3.0, 3.141592,
                                         4.5));

TEST(Rotation3, RotationBetweenTurnsTheShortestWay) {
  const Vector3d from(1, 2, -2), to(0.3, -0.1, 0.2);
  const Eigen::Quaterniond rotation = RotationBetween(from, to);
  EXPECT_THAT(rotation * from.normalized(), NearMatrix(to.normalized(), 1e-15));
  const double angle = std::acos(from.normalized().dot(to.normalized()));
  EXPECT_NEAR(RotationLog(rotation).norm(), angle, 1e-14);
  EXPECT_THAT(RotationBetween(from, 2 * from) * from, NearMatrix(from, 1e-15));
}

TEST(Rotation3, RotationBetweenOppositeDirectionsIsAHalfTurn) {
  for (const Vector3d& axis : {Vector3d(0, 0, 1), Vector3d(1, 0, 0), Vector3d(1, 2, -2)}) {
    const Eigen::Quaterniond rotation = RotationBetween(axis, -axis);
    EXPECT_THAT(rotation * axis, NearMatrix(-axis, 1e-14));
    EXPECT_NEAR(rotation.norm(), 1, 1e-15);
  }
}

TEST(Rotation3, NearestRotationFindsAScaledAndStretchedOne) {
  const Eigen::Matrix3d rotation = RotationExp(Vector3d(0.3, -2, 0.9)).toRotationMatrix();
  const Eigen::Matrix3d stretch = Vector3d(3, 1, 0.5).asDiagonal();
  EXPECT_THAT(NearestRotation(Eigen::Matrix3d(rotation * stretch)), NearMatrix(rotation, 1e-14));
  const Eigen::Matrix2d plane = Eigen::Rotation2Dd(2.5).toRotationMatrix();
  const Eigen::Matrix2d plane_stretch = Eigen::Vector2d(3, 0.5).asDiagonal();
  EXPECT_THAT(NearestRotation(Eigen::Matrix2d(plane * plane_stretch)), NearMatrix(plane, 1e-14));
}

TEST(Rotation3, NearestRotationIsNeverAReflection) {
  // Rank two, and a reflection: the direction of the least weight turns round.
  const Eigen::Matrix3d rotation = RotationExp(Vector3d(0.3, -2, 0.9)).toRotationMatrix();
  for (const Vector3d& weights : {Vector3d(2, 1, 0), Vector3d(2, 1, -0.5)}) {
    const Eigen::Matrix3d stretch = weights.asDiagonal();
    EXPECT_THAT(NearestRotation(Eigen::Matrix3d(rotation * stretch)), NearMatrix(rotation, 1e-14));
  }
}

}  // namespace
}  // namespace portolan
