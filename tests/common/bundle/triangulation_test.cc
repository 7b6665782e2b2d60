#include "common/bundle/triangulation.h"

#include <gtest/gtest.h>

#include <random>

#include "tests/support/test_cameras.h"

namespace portolan {
namespace {

class Triangulation : public ::testing::Test {
 protected:
  // Cameras along x that see `point`.
  std::vector<TrackSight> Sights(const Eigen::Vector3d& point, int count, double step) const {
    std::vector<TrackSight> sights;
    for (int i = 0; i < count; ++i) {
      const Rigid3 pose{Eigen::Quaterniond::Identity(), {step * i, 0, 0}};
      sights.push_back({{pose, &camera_}, *camera_.Project(pose.Inverse() * point), 1.0});
    }
    return sights;
  }

  const CameraModel camera_ = PinholeTestCamera();
  const TriangulationOptions options_;
};

TEST_F(Triangulation, IsExactWithoutNoise) {
  const Eigen::Vector3d point(0.3, -0.2, 4);
  const auto result = TriangulateTrack(options_, Sights(point, 5, 0.1), std::nullopt, 3.0);
  ASSERT_TRUE(result);
  EXPECT_EQ(result->inlier_count, 5);
  EXPECT_LT((result->point_in_world - point).norm(), 1e-4);
}

TEST_F(Triangulation, LeavesAWrongSightOut) {
  const Eigen::Vector3d point(0.3, -0.2, 4);
  std::vector<TrackSight> sights = Sights(point, 6, 0.1);
  sights[0].pixel += Eigen::Vector2d(40, 25);
  const auto result = TriangulateTrack(options_, sights, std::nullopt, 3.0);
  ASSERT_TRUE(result);
  EXPECT_FALSE(result->inliers[0]);
  EXPECT_EQ(result->inlier_count, 5);
  EXPECT_LT((result->point_in_world - point).norm(), 1e-3);
}

TEST_F(Triangulation, PointWithoutParallaxStaysInFront) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal(0, 1);
  for (int i = 0; i < 20; ++i) {
    std::vector<TrackSight> sights = Sights({2, 1, 500}, 4, 0.001);
    for (TrackSight& sight : sights) sight.pixel += Eigen::Vector2d(normal(random), normal(random));
    const auto result = TriangulateTrack(options_, sights, std::nullopt, 3.0);
    ASSERT_TRUE(result);
    EXPECT_GT(result->point_in_world.z(), 0);
    EXPECT_TRUE(result->point_in_world.allFinite());
  }
}

TEST_F(Triangulation, GuessDecidesWhereTheRaysDoNot) {
  const Eigen::Vector3d guess(0.3, -0.2, 4);
  const auto result = TriangulateTrack(options_, Sights(guess, 4, 0.0), guess, 3.0);
  ASSERT_TRUE(result);
  EXPECT_LT((result->point_in_world - guess).norm(), 1e-3);
}

TEST_F(Triangulation, ContradictingSightsGiveNothing) {
  std::vector<TrackSight> sights = Sights({0, 0, 4}, 2, 1.0);
  sights[1].pixel.y() += 100;
  EXPECT_FALSE(TriangulateTrack(options_, sights, std::nullopt, 3.0));
  EXPECT_FALSE(TriangulateTrack(options_, {sights[0]}, std::nullopt, 3.0));
}

}  // namespace
}  // namespace portolan
