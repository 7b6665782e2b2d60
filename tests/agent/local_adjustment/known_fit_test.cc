#include "agent/local_adjustment/known_fit.h"

#include <random>

#include "tests/support/matchers.h"
#include "tests/support/test_cameras.h"

namespace portolan {
namespace {

// Four keyframes that have drifted together from where they see the landmarks.
class KnownFit : public testing::Test {
 protected:
  KnownFit() {
    std::mt19937 random(1);
    std::uniform_real_distribution<double> x(-2, 2), z(4, 6);
    for (int k = 0; k < 4; ++k) {
      const Rigid3 truth{Eigen::Quaterniond(RotationExp({0, 0.05 * k, 0})), {0.2 * k, 0, 0.1 * k}};
      for (int i = 0; i < 20; ++i) {
        const double right = x(random), down = 0.7 * x(random), away = z(random);
        const Eigen::Vector3d point = truth * Eigen::Vector3d(right, down, away);
        const auto pixel = camera_.Project(truth.Inverse() * point);
        const KnownLandmarkId id{{}, static_cast<uint32_t>(sights_.size())};
        sights_.push_back({id, point, *pixel, 1.5});
        poses_.push_back(drifted_from_true_ * truth);
        truths_.push_back(truth);
      }
    }
  }
  std::vector<KnownView> Views() const {
    std::vector<KnownView> views;
    for (size_t i = 0; i < sights_.size(); ++i) views.push_back({poses_[i], &sights_[i]});
    return views;
  }
  double WorstError(const Similarity3& move) const {
    double worst = 0;
    for (size_t i = 0; i < poses_.size(); ++i) {
      const Rigid3 moved = move * poses_[i];
      worst = std::max(worst, (moved.translation - truths_[i].translation).norm());
    }
    return worst;
  }

  const CameraModel camera_ = PinholeTestCamera();
  const Similarity3 drifted_from_true_{
      1.03, Eigen::Quaterniond(RotationExp({0.02, -0.01, 0.015})), {0.1, -0.05, 0.08}};
  std::vector<KnownSight> sights_;
  std::vector<Rigid3> poses_;
  std::vector<Rigid3> truths_;
};

TEST_F(KnownFit, FindsTheDrift) {
  const auto move = FitToKnown({}, camera_, Views(), 5, {});
  ASSERT_TRUE(move.has_value());
  // But for the prior's pull.
  EXPECT_LT(WorstError(*move), 2e-3);
  EXPECT_THAT(*move, NearSimilarity(drifted_from_true_.Inverse(), 2e-3));
}

TEST_F(KnownFit, WrongSightsWeighLittle) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> off(-40, 40);
  for (size_t i = 0; i < sights_.size(); i += 5) {
    sights_[i].pixel += Eigen::Vector2d(off(random), off(random));
  }
  const auto move = FitToKnown({}, camera_, Views(), 5, {});
  ASSERT_TRUE(move.has_value());
  EXPECT_LT(WorstError(*move), 0.02);
}

// A window that is where it belongs, a dozen vague sights that say so, and two that do not.
TEST_F(KnownFit, AFewFalseSightsDoNotMoveAGoodWindow) {
  poses_ = truths_;
  sights_.resize(15);
  for (KnownSight& sight : sights_) sight.sigma_px = 2.5;
  for (const size_t i : {3, 8}) {
    sights_[i].sigma_px = 5;
    sights_[i].pixel += Eigen::Vector2d(7, 3);
  }
  const auto move = FitToKnown({}, camera_, Views(), 5, {});
  ASSERT_TRUE(move.has_value());
  EXPECT_LT(WorstError(*move), 2.5e-3);  // a two-thousandth of their distance
  // Were the window believed to be anywhere, they would.
  const auto loose = FitToKnown(
      {.translation_of_depth = 0.1, .rotation_rad = 0.05, .log_scale = 0.05, .map_drift_factor = 1},
      camera_, Views(), 5, {});
  ASSERT_TRUE(loose.has_value());
  EXPECT_GT(WorstError(*loose), 4 * WorstError(*move));
}

// The same sights, told again and again, do not move it farther than they do once.
TEST_F(KnownFit, WhatItHasFollowedIsNotFollowedAgain) {
  poses_ = truths_;
  sights_.resize(12);
  for (KnownSight& sight : sights_) {
    sight.sigma_px = 5;
    sight.pixel.x() += 4;
  }
  const auto once = FitToKnown({}, camera_, Views(), 5, {});
  ASSERT_TRUE(once.has_value());
  const double after_one = WorstError(*once);
  ASSERT_GT(after_one, 1e-4);
  Similarity3 moved = *once;
  for (Rigid3& pose : poses_) pose = *once * pose;
  for (int i = 0; i < 10; ++i) {
    const auto more = FitToKnown({}, camera_, Views(), 5, moved);
    ASSERT_TRUE(more.has_value());
    for (Rigid3& pose : poses_) pose = *more * pose;
    moved = *more * moved;
  }
  EXPECT_LT(WorstError(Similarity3()), 1.2 * after_one);
}

// A landmark's own error is the same in all keyframes that see it.
TEST_F(KnownFit, SightsOfOneLandmarkWeighNoMoreThanOne) {
  poses_ = truths_;
  sights_.resize(20);
  sights_[0].sigma_px = 3;
  sights_[0].pixel.x() += 6;
  const auto once = FitToKnown({}, camera_, Views(), 5, {});
  sights_.insert(sights_.begin(), 30, KnownSight(sights_[0]));
  poses_.insert(poses_.begin(), 30, Rigid3(poses_[0]));
  truths_.insert(truths_.begin(), 30, Rigid3(truths_[0]));
  const auto often = FitToKnown({}, camera_, Views(), 5, {});
  ASSERT_TRUE(once.has_value() && often.has_value());
  ASSERT_GT(WorstError(*once), 1e-5);
  EXPECT_NEAR(WorstError(*often), WorstError(*once), 0.05 * WorstError(*once));
}

TEST_F(KnownFit, TooFewSightsTellNothing) {
  sights_.resize(11);
  EXPECT_FALSE(FitToKnown({}, camera_, Views(), 5, {}).has_value());
}

TEST(KnownFitOptions, RefusesWhatMakesNoSense) {
  KnownFitOptions options;
  EXPECT_THAT(options.Validate(), IsOk());
  options.log_scale = 0;
  EXPECT_FALSE(options.Validate().ok());
  EXPECT_FALSE(KnownFitOptions{.map_drift_factor = 0.5}.Validate().ok());
}

}  // namespace
}  // namespace portolan
