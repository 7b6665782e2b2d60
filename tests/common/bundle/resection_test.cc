#include "common/bundle/resection.h"

#include <gtest/gtest.h>

#include "tests/support/test_cameras.h"

namespace portolan {
namespace {

class Resection : public ::testing::Test {
 protected:
  Resection() {
    for (int i = 0; i < 40; ++i) {
      const Eigen::Vector3d point(-2 + 0.1 * i, std::sin(3.0 * i), 3 + std::cos(5.0 * i));
      const Eigen::Vector3d origin = Eigen::Vector3d::Zero();
      points_.push_back({PointReference::At(origin, point), 1 / point.norm(), 0});
      pixels_.push_back(*camera_.Project(truth_.Inverse() * point));
    }
    for (size_t i = 0; i < points_.size(); ++i) sights_.push_back({&points_[i], pixels_[i], 0.5});
  }

  CameraModel camera_ = PinholeTestCamera();
  const Rigid3 truth_{RotationExp({0.02, -0.03, 0.01}), {0.1, -0.05, 0.08}};
  std::vector<DepthPoint> points_;
  std::vector<Eigen::Vector2d> pixels_;
  std::vector<PointSight> sights_;
};

TEST_F(Resection, FindsThePose) {
  const auto pose = Resect({}, camera_, sights_, Rigid3::Identity());
  ASSERT_TRUE(pose);
  EXPECT_LT((pose->translation - truth_.translation).norm(), 1e-6);
  EXPECT_LT(pose->rotation.angularDistance(truth_.rotation), 1e-6);
}

TEST_F(Resection, IsNotMovedMuchByAFewWrongSights) {
  for (size_t i = 0; i < 8; ++i) sights_[5 * i].pixel += Eigen::Vector2d(40, -30);
  const auto pose = Resect({}, camera_, sights_, Rigid3::Identity());
  ASSERT_TRUE(pose);
  EXPECT_LT((pose->translation - truth_.translation).norm(), 0.01);
}

TEST_F(Resection, HasNoPoseWhereLittleFits) {
  for (size_t i = 0; i < sights_.size(); ++i) {
    sights_[i].pixel = {600.0 * ((7 * i) % 40) / 40, 440.0 * ((11 * i) % 40) / 40};
  }
  EXPECT_FALSE(Resect({}, camera_, sights_, Rigid3::Identity()));
  sights_.resize(5);
  EXPECT_FALSE(Resect({}, camera_, sights_, Rigid3::Identity()));
}

TEST_F(Resection, UncertainDepthCountsAcrossItsRayOnly) {
  // The inverse depths of one half wrong by a fifth: as certain ones they bend the pose, as
  // uncertain ones hardly.
  for (size_t i = 0; i < points_.size(); i += 2) points_[i].inverse_depth *= 1.2;
  std::vector<DepthPoint> uncertain = points_;
  for (size_t i = 0; i < uncertain.size(); i += 2) uncertain[i].inverse_depth_variance = 0.01;
  const auto bent = Resect({}, camera_, sights_, truth_);
  ASSERT_TRUE(bent);
  const double bent_by = (bent->translation - truth_.translation).norm();
  EXPECT_GT(bent_by, 0.01);
  std::vector<PointSight> sights = sights_;
  for (size_t i = 0; i < sights.size(); ++i) sights[i].point = &uncertain[i];
  const auto straight = Resect({}, camera_, sights, truth_);
  ASSERT_TRUE(straight);
  EXPECT_LT((straight->translation - truth_.translation).norm(), 0.3 * bent_by);
  const Eigen::Vector2d off = sights_[0].pixel + Eigen::Vector2d(3, 3);
  const PointSight certain_sight{&points_[0], off, 0.5}, uncertain_sight{&uncertain[0], off, 0.5};
  const CameraReference camera{truth_, &camera_};
  const CameraState state(camera);
  EXPECT_LT(SightChi2(state, uncertain_sight), 0.7 * SightChi2(state, certain_sight));
}

TEST(ResectionOptions, RefusesWhatMakesNoSense) {
  EXPECT_TRUE(ResectionOptions().Validate().ok());
  EXPECT_FALSE(ResectionOptions{.max_iterations = 0}.Validate().ok());
  EXPECT_FALSE(ResectionOptions{.min_inliers = 3}.Validate().ok());
  EXPECT_FALSE(ResectionOptions{.min_inlier_share = 2}.Validate().ok());
}

}  // namespace
}  // namespace portolan
