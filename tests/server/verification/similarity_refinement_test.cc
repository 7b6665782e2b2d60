#include "server/verification/similarity_refinement.h"

#include <gtest/gtest.h>

#include <random>

#include "tests/server/verification/synthetic_pair.h"

namespace portolan {
namespace {

struct Setting {
  Similarity3 a_from_b;
  Rigid3 camera_from_submap;
  Eigen::Vector3d landmark;
};

// A random relation and a landmark at a random place of the image, the border included.
Setting RandomSetting(std::mt19937* random, const CameraModel& camera, bool from_a) {
  std::uniform_real_distribution<double> uniform(-1, 1);
  const auto vector = [&] {
    return Eigen::Vector3d(uniform(*random), uniform(*random), uniform(*random));
  };
  Setting setting;
  setting.a_from_b = {std::exp(uniform(*random)), RotationExp(vector()), vector()};
  setting.camera_from_submap = {RotationExp(vector()), vector()};
  const Eigen::Vector2d pixel(camera.width_px() * (0.5 + 0.49 * uniform(*random)),
                              camera.height_px() * (0.5 + 0.49 * uniform(*random)));
  const Eigen::Vector3d in_camera = (3 + uniform(*random)) * *camera.Unproject(pixel);
  const Eigen::Vector3d in_submap = setting.camera_from_submap.Inverse() * in_camera;
  setting.landmark = from_a ? setting.a_from_b * in_submap : setting.a_from_b.Inverse() * in_submap;
  return setting;
}

void CheckJacobians(const CameraIntrinsics& intrinsics, bool from_a) {
  const CameraModel camera = *CameraModel::Create(intrinsics);
  const auto project = from_a ? ProjectFromA : ProjectFromB;
  std::mt19937 random(5);
  for (int i = 0; i < 100; ++i) {
    const Setting s = RandomSetting(&random, camera, from_a);
    const auto at = project(s.a_from_b, s.landmark, s.camera_from_submap, camera);
    ASSERT_TRUE(at);
    const double step = 1e-6;
    for (int k = 0; k < 7; ++k) {
      const Vector7d d = step * Vector7d::Unit(k);
      const auto plus =
          project(s.a_from_b * Similarity3::Exp(d), s.landmark, s.camera_from_submap, camera);
      const auto minus =
          project(s.a_from_b * Similarity3::Exp(-d), s.landmark, s.camera_from_submap, camera);
      ASSERT_TRUE(plus && minus);
      const Eigen::Vector2d numeric = (plus->pixel - minus->pixel) / (2 * step);
      EXPECT_LT((numeric - at->d_pixel_d_a_from_b.col(k)).norm(), 1e-4 * (1 + numeric.norm()));
    }
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector3d d = step * Eigen::Vector3d::Unit(k);
      const auto plus = project(s.a_from_b, s.landmark + d, s.camera_from_submap, camera);
      const auto minus = project(s.a_from_b, s.landmark - d, s.camera_from_submap, camera);
      ASSERT_TRUE(plus && minus);
      const Eigen::Vector2d numeric = (plus->pixel - minus->pixel) / (2 * step);
      EXPECT_LT((numeric - at->d_pixel_d_landmark.col(k)).norm(), 1e-4 * (1 + numeric.norm()));
    }
  }
}

constexpr CameraIntrinsics kRadTan = {
    640, 480, 420, 410, 320, 240, DistortionModel::kRadTan, {-0.2, 0.04, 0.0002, -0.0003, 0}};
constexpr CameraIntrinsics kFisheye = {
    640, 480, 340, 340, 320, 240, DistortionModel::kEquidistant, {-0.01, -0.03, 0, 0, 0}};

TEST(SimilarityRefinement, JacobiansFromA) {
  CheckJacobians(kRadTan, true);
  CheckJacobians(kFisheye, true);
}

TEST(SimilarityRefinement, JacobiansFromB) {
  CheckJacobians(kRadTan, false);
  CheckJacobians(kFisheye, false);
}

// The true matches of a synthetic pair, by track id.
std::vector<PointMatch> TrueMatches(const SubmapPoints& a, const SubmapPoints& b) {
  std::vector<PointMatch> matches;
  for (size_t i = 0; i < a.points.size(); ++i) {
    for (size_t j = 0; j < b.points.size(); ++j) {
      if (a.points[i].track->value() + 1000 != b.points[j].track->value()) continue;
      if (a.points[i].track->value() < 250) {
        matches.push_back({static_cast<int>(i), static_cast<int>(j), 0, 0, 0});
      }
    }
  }
  return matches;
}

TEST(SimilarityRefinement, ConvergesFromAPoorStartDespiteOutliers) {
  const SyntheticPair pair = MakeSyntheticPair({});
  const auto a = MakeSubmapPoints(pair.a, 1000), b = MakeSubmapPoints(pair.b, 1000);
  ASSERT_TRUE(a && b);
  std::vector<PointMatch> matches = TrueMatches(*a, *b);
  ASSERT_GT(matches.size(), 80u);
  for (size_t i = 0; i + 10 < matches.size(); i += 10) std::swap(matches[i].b, matches[i + 5].b);
  Vector7d offset;
  offset << 0.05, -0.05, 0.05, 0.02, -0.03, 0.02, 0.1;
  SimilarityRefinementOptions options;
  options.max_iterations = 30;
  const auto refined =
      RefineSimilarity(*a, *b, matches, pair.a_from_b * Similarity3::Exp(offset), options);
  ASSERT_TRUE(refined);
  EXPECT_LT((pair.a_from_b.Inverse() * refined->a_from_b).Log().norm(), 0.03);
  EXPECT_GT(refined->chi_squared[0], 12.0);  // a swapped one
  EXPECT_LT(refined->chi_squared[1], 12.0);
}

TEST(SimilarityRefinement, FixedScaleStaysAndTooFewMatchesFail) {
  const SyntheticPair pair = MakeSyntheticPair({});
  const auto a = MakeSubmapPoints(pair.a, 1000), b = MakeSubmapPoints(pair.b, 1000);
  ASSERT_TRUE(a && b);
  SimilarityRefinementOptions options;
  options.fixed_scale = true;
  const auto matches = TrueMatches(*a, *b);
  const auto refined = RefineSimilarity(*a, *b, matches, pair.a_from_b, options);
  ASSERT_TRUE(refined);
  EXPECT_EQ(refined->a_from_b.scale, pair.a_from_b.scale);
  EXPECT_FALSE(RefineSimilarity(*a, *b, {matches[0], matches[1]}, pair.a_from_b, options));
}

}  // namespace
}  // namespace portolan
