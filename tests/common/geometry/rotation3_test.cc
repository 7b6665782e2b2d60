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

}  // namespace
}  // namespace portolan
