#include "tests/synthetic/body_path.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/support/matchers.h"
#include "tests/synthetic/random.h"

namespace portolan::synthetic {
namespace {

BodyPath RandomPath(uint64_t seed) {
  Random random(seed);
  std::vector<PathKnot> knots;
  for (int i = 0; i < 12; ++i) {
    knots.push_back({random.Normal3(), 0.4 * random.Normal3() + Eigen::Vector3d(0.3 * i, 0, 0)});
  }
  return BodyPath(std::move(knots), 0.25);
}

TEST(BodyPath, SpansItsKnots) { EXPECT_DOUBLE_EQ(RandomPath(1).duration_s(), 9 * 0.25); }

TEST(BodyPath, VelocityAndAccelerationAreTheDerivatives) {
  const BodyPath path = RandomPath(2);
  const double h = 1e-5;
  for (const double t : {0.1, 0.333, 0.76, 1.4, 2.2}) {
    const BodyState before = path.At(t - h), here = path.At(t), after = path.At(t + h);
    const Eigen::Vector3d velocity =
        (after.world_from_body.translation - before.world_from_body.translation) / (2 * h);
    const Eigen::Vector3d acceleration =
        (after.velocity_in_world - before.velocity_in_world) / (2 * h);
    EXPECT_THAT(here.velocity_in_world, NearMatrix(velocity, 1e-6));
    EXPECT_THAT(here.acceleration_in_world, NearMatrix(acceleration, 1e-4));
  }
}

TEST(BodyPath, AngularVelocityIsTheDerivativeOfTheRotation) {
  const BodyPath path = RandomPath(3);
  const double h = 1e-5;
  for (const double t : {0.1, 0.333, 0.76, 1.4, 2.2}) {
    const Eigen::Quaterniond before = path.At(t - h).world_from_body.rotation;
    const Eigen::Quaterniond after = path.At(t + h).world_from_body.rotation;
    const Eigen::Vector3d rate = RotationLog(before.conjugate() * after) / (2 * h);
    EXPECT_THAT(path.At(t).angular_velocity_in_body, NearMatrix(rate, 1e-6));
  }
}

TEST(BodyPath, IsSmoothAtKnots) {
  const BodyPath path = RandomPath(4);
  for (int i = 1; i < 9; ++i) {
    const BodyState before = path.At(0.25 * i - 1e-9), after = path.At(0.25 * i + 1e-9);
    EXPECT_THAT(after.acceleration_in_world, NearMatrix(before.acceleration_in_world, 1e-4));
    EXPECT_THAT(after.angular_velocity_in_body, NearMatrix(before.angular_velocity_in_body, 1e-6));
  }
}

TEST(BodyPath, StandsWhereKnotsStand) {
  const PathKnot knot{{1, 2, 3}, {0.1, 0.2, 0.3}};
  const BodyPath path({knot, knot, knot, knot, knot}, 0.25);
  const BodyState state = path.At(0.3);
  EXPECT_THAT(state.world_from_body.translation, NearMatrix(knot.position_m, 1e-12));
  EXPECT_NEAR(state.velocity_in_world.norm(), 0, 1e-12);
  EXPECT_NEAR(state.angular_velocity_in_body.norm(), 0, 1e-12);
}

}  // namespace
}  // namespace portolan::synthetic
