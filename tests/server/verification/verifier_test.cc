#include "server/verification/verifier.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <limits>
#include <set>

#include "tests/server/verification/synthetic_pair.h"

namespace portolan {
namespace {

Verifier MakeVerifier() {
  auto verifier = Verifier::Create({});
  EXPECT_TRUE(verifier.ok());
  return *verifier;
}

std::optional<Closure> VerifyPair(const SyntheticPair& pair, VerificationReport* report) {
  return MakeVerifier().Verify(pair.a, pair.b, report);
}

// Accepted, near the truth, and every match right.
void ExpectCorrect(const SyntheticPairOptions& options) {
  const SyntheticPair pair = MakeSyntheticPair(options);
  VerificationReport report;
  const auto closure = VerifyPair(pair, &report);
  ASSERT_TRUE(closure) << report.refusal << ", evidence " << report.evidence << ", rival "
                       << report.rival_share << ", sigmas " << report.rotation_sigma_rad << " "
                       << report.log_scale_sigma << " " << report.relative_translation_sigma;
  EXPECT_EQ(closure->a, pair.a.id);
  EXPECT_EQ(closure->b, pair.b.id);
  const Similarity3 error = pair.a_from_b.Inverse() * closure->a_from_b;
  EXPECT_LT(error.Log().segment<3>(3).norm(), 0.01);
  EXPECT_LT(std::abs(std::log(error.scale)), 0.03);
  EXPECT_LT(error.translation.norm() * options.scale, 0.1);
  EXPECT_GE(closure->matches.size(), 20u);
  EXPECT_LT(closure->rms_px, 2.0);
  std::set<TrackId> in_a, in_b;
  int wrong = 0;
  for (const LandmarkMatch& match : closure->matches) {
    EXPECT_TRUE(in_a.insert(match.in_a).second);
    EXPECT_TRUE(in_b.insert(match.in_b).second);
    wrong += match.in_b.value() != match.in_a.value() + 1000;
  }
  EXPECT_LE(wrong, 1);
}

TEST(Verifier, FindsScaleAndPose) { ExpectCorrect({}); }

TEST(Verifier, IsCorrectForManySeeds) {
  for (uint32_t seed = 10; seed < 30; ++seed) {
    SyntheticPairOptions options;
    options.seed = seed;
    options.scale = 0.3 + 0.2 * (seed % 10);
    ExpectCorrect(options);
  }
}

TEST(Verifier, PlanarScene) {
  SyntheticPairOptions options;
  options.shape = SceneShape::kPlane;
  ExpectCorrect(options);
}

TEST(Verifier, ManyOutliers) {
  SyntheticPairOptions options;
  options.points = 130;
  options.private_points = 350;
  options.noise_bits = 18;
  ExpectCorrect(options);
}

TEST(Verifier, LowParallaxContributesThroughRays) {
  SyntheticPairOptions options;
  options.path = 0.25;
  ExpectCorrect(options);
}

TEST(Verifier, WideAngleLens) {
  SyntheticPairOptions options;
  options.camera = {640, 480, 260, 260, 320, 240, DistortionModel::kEquidistant, {}};
  options.camera.coefficients = {-0.01, -0.03, 0.0, 0.0, 0.0};
  ExpectCorrect(options);
}

// Their own scales have errors of some percent, which the closure measures; more is refused.
TEST(Verifier, MetricSubmapsHaveNearlyScaleOne) {
  SyntheticPairOptions options;
  options.metric = true;
  options.scale = 1.03;
  ExpectCorrect(options);
  options.scale = 1.5;
  VerificationReport report;
  EXPECT_FALSE(VerifyPair(MakeSyntheticPair(options), &report));
  EXPECT_EQ(report.refusal, "metric scales disagree");
}

// The error of the result against its own information, over seeds: chi-square with 7 degrees of
// freedom has mean 7; the matches of one submap share its camera poses, so this may be off, but
// not by much.
TEST(Verifier, InformationIsConsistent) {
  double sum = 0;
  int count = 0;
  for (uint32_t seed = 100; seed < 140; ++seed) {
    SyntheticPairOptions options;
    options.seed = seed;
    const SyntheticPair pair = MakeSyntheticPair(options);
    const auto closure = VerifyPair(pair, nullptr);
    if (!closure) continue;
    const Vector7d error = (pair.a_from_b.Inverse() * closure->a_from_b).Log();
    sum += error.dot(closure->information * error);
    ++count;
  }
  ASSERT_GE(count, 38);
  EXPECT_LT(sum / count, 10.0);
  EXPECT_GT(sum / count, 0.1);
}

TEST(Verifier, RefusesDifferentPlaces) {
  for (uint32_t seed = 1; seed < 40; ++seed) {
    SyntheticPairOptions options;
    options.seed = seed;
    const SyntheticPair first = MakeSyntheticPair(options);
    options.seed = seed + 1000;
    const SyntheticPair second = MakeSyntheticPair(options);
    EXPECT_FALSE(MakeVerifier().Verify(first.a, second.b)) << "seed " << seed;
  }
}

// Descriptors say that all points are one: nothing may be concluded.
TEST(Verifier, RefusesLatticeOfIdenticalPoints) {
  SyntheticPairOptions options;
  options.shape = SceneShape::kLattice;
  options.identical_descriptors = true;
  VerificationReport report;
  EXPECT_FALSE(VerifyPair(MakeSyntheticPair(options), &report));
  EXPECT_FALSE(report.refusal.empty());
}

TEST(Verifier, RefusesVolumeOfIdenticalPoints) {
  for (uint32_t seed = 1; seed < 20; ++seed) {
    SyntheticPairOptions options;
    options.seed = seed;
    options.identical_descriptors = true;
    EXPECT_FALSE(VerifyPair(MakeSyntheticPair(options), nullptr)) << "seed " << seed;
  }
}

TEST(Verifier, RefusesFewCommonPoints) {
  SyntheticPairOptions options;
  options.points = 18;
  options.private_points = 200;
  EXPECT_FALSE(VerifyPair(MakeSyntheticPair(options), nullptr));
}

// A fifth of what should be visible is found again: of one place everywhere, of two places that
// have a poster in common on the poster only.
TEST(Verifier, FewFoundAgainMustLieAllOverTheView) {
  for (uint32_t seed = 1; seed <= 10; ++seed) {
    SyntheticPairOptions options;
    options.seed = seed;
    options.points = 75;
    options.private_points = 350;
    ExpectCorrect(options);
    VerificationReport report;
    VerifyPair(MakeSyntheticPair(options), &report);
    EXPECT_LT(report.visible_share, VerifierOptions().max_share_to_ask_evenness);
    EXPECT_GT(report.evenness, VerifierOptions().min_evenness);
    options.common_from_x = 1.0;
    EXPECT_FALSE(VerifyPair(MakeSyntheticPair(options), &report)) << "seed " << seed;
    EXPECT_EQ(report.refusal, "matches in one part of the view only");
    EXPECT_GT(report.visible_share, VerifierOptions().min_visible_share);
  }
}

TEST(Verifier, RefusesWhenGravityDisagrees) {
  SyntheticPair pair = MakeSyntheticPair({});
  ASSERT_TRUE(VerifyPair(pair, nullptr));
  Submap a = *pair.a.raw, b = *pair.b.raw;
  b.gravity_in_submap = Eigen::Vector3d::UnitY();
  a.gravity_in_submap = pair.a_from_b.rotation * Eigen::Vector3d::UnitY();
  pair.a.raw = std::make_shared<Submap>(a);
  pair.b.raw = std::make_shared<Submap>(b);
  EXPECT_TRUE(VerifyPair(pair, nullptr));
  a.gravity_in_submap = RotationExp({0, 0, 0.4}) * *a.gravity_in_submap;
  pair.a.raw = std::make_shared<Submap>(a);
  VerificationReport report;
  EXPECT_FALSE(VerifyPair(pair, &report));
  EXPECT_EQ(report.refusal, "gravity disagrees");
}

TEST(Verifier, IsDeterministic) {
  const SyntheticPair pair = MakeSyntheticPair({});
  const auto first = VerifyPair(pair, nullptr), second = VerifyPair(pair, nullptr);
  ASSERT_TRUE(first && second);
  EXPECT_EQ(first->a_from_b.translation, second->a_from_b.translation);
  EXPECT_EQ(first->matches, second->matches);
  EXPECT_EQ(first->information, second->information);
}

TEST(Verifier, EmptyAndBrokenSubmapsAreRefused) {
  const SyntheticPair pair = MakeSyntheticPair({});
  EXPECT_FALSE(MakeVerifier().Verify(RefinedSubmap(), pair.b));
  EXPECT_FALSE(MakeVerifier().Verify(pair.a, RefinedSubmap()));
  RefinedSubmap quarantined = pair.a;
  quarantined.quarantine_reason = "implausible";
  EXPECT_FALSE(MakeVerifier().Verify(quarantined, pair.b));
  RefinedSubmap without_poses = pair.a;
  without_poses.submap_from_camera.clear();
  EXPECT_FALSE(MakeVerifier().Verify(without_poses, pair.b));
  Submap undescribed = *pair.a.raw;
  for (Keyframe& keyframe : undescribed.keyframes) keyframe.features.clear();
  RefinedSubmap without_features = pair.a;
  without_features.raw = std::make_shared<Submap>(undescribed);
  EXPECT_FALSE(MakeVerifier().Verify(without_features, pair.b));
}

TEST(Verifier, NonFiniteAndRepeatedFeaturesDoNoHarm) {
  SyntheticPair pair = MakeSyntheticPair({});
  Submap odd = *pair.a.raw;
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (Keyframe& keyframe : odd.keyframes) {
    if (keyframe.features.empty()) continue;
    const Feature copy = keyframe.features.front();
    keyframe.features.insert(keyframe.features.end(), 300, copy);
    keyframe.features[5].pixel = {nan, 1e30f};
    keyframe.features[6].pixel = {-1e30f, 1e30f};
    keyframe.observations[7].pixel = {nan, nan};
    keyframe.observations[8].sigma_px = 0;
  }
  pair.a.raw = std::make_shared<Submap>(odd);
  const auto closure = VerifyPair(pair, nullptr);
  EXPECT_TRUE(!closure || closure->information.allFinite());
}

TEST(VerifierOptions, RefusesNonsense) {
  VerifierOptions options;
  options.evidence.sigma_px = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(Verifier::Create(options).ok());
  options = {};
  options.min_inliers = 0;
  EXPECT_FALSE(Verifier::Create(options).ok());
  for (double VerifierOptions::*share :
       {&VerifierOptions::min_inlier_share, &VerifierOptions::min_visible_share,
        &VerifierOptions::min_evenness, &VerifierOptions::max_share_to_ask_evenness}) {
    for (const double wrong : {-0.1, 1.5, std::numeric_limits<double>::quiet_NaN()}) {
      options = {};
      options.*share = wrong;
      EXPECT_FALSE(Verifier::Create(options).ok()) << wrong;
    }
  }
}

}  // namespace
}  // namespace portolan
