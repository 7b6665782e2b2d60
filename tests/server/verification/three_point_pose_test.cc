#include "server/verification/three_point_pose.h"

#include <gtest/gtest.h>

#include <limits>
#include <random>

namespace portolan {
namespace {

Eigen::Vector3d RandomVector(std::mt19937* random, double range) {
  std::uniform_real_distribution<double> uniform(-range, range);
  return {uniform(*random), uniform(*random), uniform(*random)};
}

TEST(ThreePointPose, FindsTheTruePoseAmongItsSolutions) {
  std::mt19937 random(3);
  int found = 0;
  const int count = 500;
  for (int i = 0; i < count; ++i) {
    const Rigid3 world_from_camera = {RotationExp(RandomVector(&random, 1.5)),
                                      RandomVector(&random, 3)};
    ThreePoints points, bearings;
    for (int k = 0; k < 3; ++k) {
      // Up to 60 degrees off the axis and beyond: no image plane is needed.
      const Eigen::Vector3d in_camera = RandomVector(&random, 4) + Eigen::Vector3d(0, 0, 3);
      points.col(k) = world_from_camera * in_camera;
      bearings.col(k) = in_camera.normalized();
    }
    const auto poses = SolveThreePointPose(points, bearings);
    EXPECT_LE(poses.size(), 4u);
    double best = 1e9;
    for (const Rigid3& pose : poses) {
      best = std::min(best, (pose.Inverse() * world_from_camera).Log().norm());
      for (int k = 0; k < 3; ++k) {  // every solution must explain the rays
        const Eigen::Vector3d ray = (pose.Inverse() * points.col(k).eval()).normalized();
        EXPECT_LT((ray - bearings.col(k)).norm(), 1e-5);
      }
    }
    found += best < 1e-4;
  }
  // Nearly double roots may be lost.
  EXPECT_GE(found, count * 98 / 100);
}

TEST(ThreePointPose, CollinearAndEqualPointsGiveNothing) {
  ThreePoints points, bearings;
  points << 0, 1, 2, 0, 1, 2, 5, 6, 7;
  bearings.colwise() = Eigen::Vector3d::UnitZ();
  EXPECT_TRUE(SolveThreePointPose(points, bearings).empty());
  points.setZero();
  EXPECT_TRUE(SolveThreePointPose(points, bearings).empty());
  points.setConstant(std::numeric_limits<double>::quiet_NaN());
  EXPECT_TRUE(SolveThreePointPose(points, bearings).empty());
  EXPECT_FALSE(AlignThreePoints(points, points, false));
}

TEST(AlignThreePoints, RecoversTheSimilarity) {
  std::mt19937 random(4);
  for (int i = 0; i < 100; ++i) {
    Similarity3 a_from_b;
    a_from_b.scale = 0.2 + 0.1 * i;
    a_from_b.rotation = RotationExp(RandomVector(&random, 1.5));
    a_from_b.translation = RandomVector(&random, 3);
    ThreePoints in_a, in_b;
    for (int k = 0; k < 3; ++k) {
      in_b.col(k) = RandomVector(&random, 2);
      in_a.col(k) = a_from_b * in_b.col(k).eval();
    }
    const auto aligned = AlignThreePoints(in_a, in_b, false);
    if (!aligned) continue;
    EXPECT_LT((a_from_b.Inverse() * *aligned).Log().norm(), 1e-6);
    const auto rigid = AlignThreePoints(in_a, in_b, true);
    ASSERT_TRUE(rigid);
    EXPECT_EQ(rigid->scale, 1.0);
  }
}

}  // namespace
}  // namespace portolan
