#include "common/geometry/rigid3.h"

#include <numbers>

#include "tests/support/matchers.h"

namespace portolan {
namespace {

using Eigen::Vector3d;

TEST(Rigid3, MapsPointFromBToA) {
  const Rigid3 a_from_b{RotationExp(Vector3d(0, 0, std::numbers::pi / 2)), Vector3d(10, 0, 0)};
  EXPECT_THAT(a_from_b * Vector3d(1, 0, 5), NearMatrix(Vector3d(10, 1, 5), 1e-14));
}

TEST(Rigid3, MatrixActsAsTheMotion) {
  const Rigid3 a_from_b{RotationExp(Vector3d(0.1, -2, 0.7)), Vector3d(1, 2, 3)};
  const Vector3d point(-4, 5, 6);
  const Eigen::Vector4d mapped = a_from_b.Matrix() * point.homogeneous();
  EXPECT_THAT(mapped.hnormalized(), NearMatrix(a_from_b * point, 1e-13));
}

TEST(Rigid3, ExpIsAScrewOfConstantVelocity) {
  // Half of the twist applied twice is the whole twist; pure translation is kept as it is.
  Vector6d twist;
  twist << 1, -2, 0.5, 0.3, 1.1, -0.8;
  EXPECT_THAT(Rigid3::Exp(0.5 * twist) * Rigid3::Exp(0.5 * twist),
              NearRigid(Rigid3::Exp(twist), 1e-14));
  Vector6d slide;
  slide << 1, 2, 3, 0, 0, 0;
  EXPECT_THAT(Rigid3::Exp(slide).translation, NearMatrix(Vector3d(1, 2, 3), 0));
}

TEST(Rigid3, QuarterTurnTwistMovesOnAQuarterCircle) {
  Vector6d twist;  // forward speed pi/2 while turning by pi/2 about z: a circle of radius 1
  twist << std::numbers::pi / 2, 0, 0, 0, 0, std::numbers::pi / 2;
  EXPECT_THAT(Rigid3::Exp(twist).translation, NearMatrix(Vector3d(1, 1, 0), 1e-14));
}

}  // namespace
}  // namespace portolan
