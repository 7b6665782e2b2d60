#include "common/geometry/similarity3.h"

#include <unsupported/Eigen/MatrixFunctions>

#include "tests/support/matchers.h"

namespace portolan {
namespace {

using Eigen::Vector3d;

Vector7d MakeTangent(double angle, double log_scale) {
  Vector7d tangent;
  tangent << 0.7, -1.3, 2.1, angle * Vector3d(0.6, -0.48, 0.64), log_scale;
  return tangent;
}

TEST(Similarity3, MapsPointWithScaleFirst) {
  const Similarity3 a_from_b{2.0, RotationExp(Vector3d(0, 0, std::acos(-1.0) / 2)),
                             Vector3d(10, 0, 0)};
  EXPECT_THAT(a_from_b * Vector3d(1, 0, 5), NearMatrix(Vector3d(10, 2, 10), 1e-14));
}

TEST(Similarity3, PlacesARigidFrameLikeItsOrigin) {
  const Similarity3 a_from_b = Similarity3::Exp(MakeTangent(1.0, 0.4));
  const Rigid3 b_from_c{RotationExp(Vector3d(0.2, 0.1, -0.5)), Vector3d(3, -1, 2)};
  const Rigid3 a_from_c = a_from_b * b_from_c;
  EXPECT_THAT(a_from_c.translation, NearMatrix(a_from_b * b_from_c.translation, 1e-14));
  EXPECT_THAT(a_from_c, NearRigid((a_from_b * Similarity3::FromRigid(b_from_c)).Rigid(), 1e-14));
}

TEST(Similarity3, WithUnitScaleIsTheRigidGroup) {
  const Vector7d tangent = MakeTangent(0.8, 0);
  const Similarity3 similarity = Similarity3::Exp(tangent);
  EXPECT_EQ(similarity.scale, 1.0);
  EXPECT_THAT(similarity.Rigid(), NearRigid(Rigid3::Exp(tangent.head<6>()), 1e-14));
}

// The closed form and its series against the exponential of the 4x4 matrix of the algebra.
TEST(Similarity3, ExpEqualsMatrixExponential) {
  for (double angle : {0.0, 1e-10, 1e-4, 0.0099, 0.0101, 1.0, 3.1}) {
    for (double log_scale : {0.0, 1e-13, -1e-6, 1e-3, -0.4, 0.99, 1.01, -1.01, 2.0, -3.0}) {
      const Vector7d tangent = MakeTangent(angle, log_scale);
      Eigen::Matrix4d algebra = Eigen::Matrix4d::Zero();
      algebra.topLeftCorner<3, 3>() =
          Skew(tangent.segment<3>(3)) + log_scale * Eigen::Matrix3d::Identity();
      algebra.topRightCorner<3, 1>() = tangent.head<3>();
      const Eigen::Matrix4d expected = algebra.exp();
      const Similarity3 actual = Similarity3::Exp(tangent);
      const Eigen::Vector3d expected_translation = expected.topRightCorner<3, 1>();
      EXPECT_THAT(actual.translation, NearMatrix(expected_translation, 1e-11))
          << angle << " " << log_scale;
      const Eigen::Matrix3d expected_linear = expected.topLeftCorner<3, 3>();
      EXPECT_THAT(actual.scale * actual.rotation.toRotationMatrix(),
                  NearMatrix(expected_linear, 1e-11));
    }
  }
}

TEST(Similarity3, LogInvertsExpAtLargeAndTinyScales) {
  for (double log_scale : {-5.0, -1e-9, 1e-9, 5.0}) {
    for (double angle : {0.0, 0.005, 2.0}) {
      const Vector7d tangent = MakeTangent(angle, log_scale);
      EXPECT_THAT(Similarity3::Exp(tangent).Log(), NearMatrix(tangent, 1e-11));
    }
  }
}

}  // namespace
}  // namespace portolan
