#include "server/refinement/submap_refiner.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/synthetic_submaps.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;

std::shared_ptr<const RefinedSubmap> Refine(const SyntheticMission& mission, size_t index) {
  return SubmapRefiner::Create({})->Refine(mission.submaps[index].id, mission.submaps[index].submap,
                                           mission.camera);
}

double PositionError(const SyntheticSubmap& truth, const std::vector<Rigid3>& poses) {
  std::vector<Eigen::Vector3d> estimate, expected;
  for (size_t k = 0; k < poses.size(); ++k) {
    estimate.push_back(poses[k].translation);
    expected.push_back(truth.world_from_camera[k].translation);
  }
  return AlignedRms(estimate, expected);
}

std::vector<Rigid3> FilterPoses(const Submap& submap) {
  std::vector<Rigid3> poses;
  for (const Keyframe& keyframe : submap.keyframes) poses.push_back(keyframe.submap_from_camera);
  return poses;
}

TEST(SubmapRefiner, RecoversTheGeometryWithoutNoise) {
  SyntheticSubmapsOptions options;
  options.pixel_sigma = 0;
  options.agents[0].submaps = 1;
  options.agents[0].end_rad = 0.6;
  const SyntheticMission mission = MakeSyntheticMission(options);
  const auto refined = Refine(mission, 0);
  EXPECT_EQ(refined->quarantine_reason, "");
  EXPECT_GT(PositionError(mission.submaps[0], FilterPoses(*refined->raw)), 1e-3);
  EXPECT_LT(PositionError(mission.submaps[0], refined->submap_from_camera), 2e-5);
  EXPECT_GT(refined->landmarks.size(), 100u);
}

TEST(SubmapRefiner, NoisyPixelsAndOutliersStillGainOnTheFilter) {
  SyntheticSubmapsOptions options;
  options.outlier_share = 0.05;
  options.drift_rotation_rad = 0.005;
  options.drift_translation_share = 0.05;
  options.agents[0].submaps = 1;
  options.agents[0].end_rad = 0.6;
  const SyntheticMission mission = MakeSyntheticMission(options);
  const auto refined = Refine(mission, 0);
  EXPECT_EQ(refined->quarantine_reason, "");
  EXPECT_LT(PositionError(mission.submaps[0], refined->submap_from_camera),
            0.3 * PositionError(mission.submaps[0], FilterPoses(*refined->raw)));
  EXPECT_LT(refined->rms_reprojection_px, 1.0);
}

// Cosine between the true and the estimated positions in the submap's frame; no alignment.
double MotionAgreement(const SyntheticSubmap& truth, const std::vector<Rigid3>& poses) {
  const Similarity3 submap_from_world = truth.world_from_submap.Inverse();
  double dot = 0, squares = 0, true_squares = 0;
  for (size_t k = 0; k < poses.size(); ++k) {
    const Eigen::Vector3d expected = submap_from_world * truth.world_from_camera[k].translation;
    dot += expected.dot(poses[k].translation);
    squares += poses[k].translation.squaredNorm();
    true_squares += expected.squaredNorm();
  }
  return dot / std::sqrt(squares * true_squares);
}

// The motion that nearly explains the same images with depths reversed about `depth`.
Rigid3 DepthReversed(Rigid3 motion, double depth) {
  Eigen::Vector3d& t = motion.translation;
  motion.rotation = RotationExp(2 / depth * Eigen::Vector3d(-t.y(), t.x(), 0)) * motion.rotation;
  t.head<2>() = -t.head<2>();
  return motion;
}

// The submap as a filter would tell it that settled in the depth-reversed solution.
std::shared_ptr<const Submap> Reversed(const SyntheticSubmap& truth, double depth) {
  auto submap = std::make_shared<Submap>(*truth.submap);
  submap->landmarks.clear();
  for (Keyframe& keyframe : submap->keyframes) {
    keyframe.submap_from_camera = DepthReversed(keyframe.submap_from_camera, depth);
  }
  return submap;
}

struct BothWays {
  std::shared_ptr<const RefinedSubmap> stuck;  // without other starts
  std::shared_ptr<const RefinedSubmap> refined;
};

BothWays RefineBothWays(const SyntheticMission& mission, std::shared_ptr<const Submap> start) {
  SubmapRefinerOptions without;
  without.try_other_starts = false;
  const SubmapId id = mission.submaps[0].id;
  return {SubmapRefiner::Create(without)->Refine(id, start, mission.camera),
          SubmapRefiner::Create({})->Refine(id, start, mission.camera)};
}

TEST(SubmapRefiner, LeavesTheDepthReversedSolution) {
  SyntheticSubmapsOptions options;
  options.agents[0].submaps = 1;
  options.agents[0].end_rad = 0.15;
  const SyntheticMission mission = MakeSyntheticMission(options);
  const auto start = Reversed(mission.submaps[0], 2.5 * options.unit);
  const auto [stuck, refined] = RefineBothWays(mission, start);
  EXPECT_LT(MotionAgreement(mission.submaps[0], stuck->submap_from_camera), 0);
  EXPECT_EQ(refined->quarantine_reason, "");
  EXPECT_GT(MotionAgreement(mission.submaps[0], refined->submap_from_camera), 0.98);
  EXPECT_GT(refined->landmarks.size(), 100u);
}

// The submap of a filter that took turn for translation up to the middle and found out there: the
// first half of the motion is depth-reversed, seen from the middle, and the landmarks are those of
// the end.
std::shared_ptr<const Submap> BegunWrong(const SyntheticSubmap& truth, double depth) {
  auto submap = std::make_shared<Submap>(*truth.submap);
  std::vector<Keyframe>& keyframes = submap->keyframes;
  const size_t middle = keyframes.size() / 2;
  const Rigid3 from_middle = keyframes[middle].submap_from_camera;
  for (size_t k = 0; k < middle; ++k) {
    keyframes[k].submap_from_camera =
        from_middle * DepthReversed(from_middle.Inverse() * keyframes[k].submap_from_camera, depth);
  }
  const Rigid3 new_from_old = keyframes[0].submap_from_camera.Inverse();
  for (Keyframe& keyframe : keyframes) {
    keyframe.submap_from_camera = new_from_old * keyframe.submap_from_camera;
  }
  for (SubmapLandmark& landmark : submap->landmarks) {
    landmark.point_in_submap = new_from_old * landmark.point_in_submap;
  }
  return submap;
}

TEST(SubmapRefiner, StartsFromTheEndOfASubmapThatBeganWrong) {
  SyntheticSubmapsOptions options;
  options.agents[0].submaps = 1;
  options.agents[0].end_rad = 0.5;
  const SyntheticMission mission = MakeSyntheticMission(options);
  const auto start = BegunWrong(mission.submaps[0], 2.5 * options.unit);
  const auto [stuck, refined] = RefineBothWays(mission, start);
  EXPECT_LT(MotionAgreement(mission.submaps[0], stuck->submap_from_camera), 0.5);
  EXPECT_EQ(refined->quarantine_reason, "");
  EXPECT_GT(MotionAgreement(mission.submaps[0], refined->submap_from_camera), 0.999);
  EXPECT_LT(refined->rms_reprojection_px, 0.8);
}

TEST(SubmapRefiner, LandmarkCovariancesMatchTheirErrors) {
  SyntheticSubmapsOptions options;
  options.agents[0].submaps = 1;
  options.agents[0].end_rad = 0.6;
  double nees = 0;
  int count = 0;
  for (uint32_t seed = 1; seed <= 10; ++seed) {
    options.seed = seed;
    const SyntheticMission mission = MakeSyntheticMission(options);
    const auto refined = Refine(mission, 0);
    double estimated = 0, expected = 0;
    const Similarity3 submap_from_world = mission.submaps[0].world_from_submap.Inverse();
    for (size_t k = 1; k < refined->submap_from_camera.size(); ++k) {
      const Eigen::Vector3d truth =
          submap_from_world * mission.submaps[0].world_from_camera[k].translation;
      estimated += truth.dot(refined->submap_from_camera[k].translation);
      expected += truth.squaredNorm();
    }
    for (const RefinedLandmark& landmark : refined->landmarks) {
      if (landmark.observation_count < 5) continue;
      const Eigen::Vector3d error =
          expected / estimated * landmark.point_in_submap -
          submap_from_world * mission.points_of_tracks[0].at(landmark.track);
      nees += error.dot(landmark.covariance.Matrix().ldlt().solve(error));
      ++count;
    }
  }
  // Landmarks of one run share the cameras' errors, so the band is wider than that of chi-square.
  EXPECT_GT(nees / count, 2.3);
  EXPECT_LT(nees / count, 4.0);
}

TEST(SubmapRefiner, PureRotationStaysBounded) {
  SyntheticSubmapsOptions options;
  options.agents[0] = {0, 0.5, 1, 0.0};
  const SyntheticMission mission = MakeSyntheticMission(options);
  const auto refined = Refine(mission, 0);
  EXPECT_EQ(refined->quarantine_reason, "");
  for (size_t k = 0; k < refined->submap_from_camera.size(); ++k) {
    EXPECT_LT(refined->submap_from_camera[k].translation.norm(), 0.3);
    const Rigid3 truth =
        mission.submaps[0].world_from_camera[0].Inverse() * mission.submaps[0].world_from_camera[k];
    EXPECT_LT((truth.Inverse() * refined->submap_from_camera[k]).Log().tail<3>().norm(), 0.01);
  }
  for (const RefinedLandmark& landmark : refined->landmarks) {
    EXPECT_TRUE(landmark.point_in_submap.allFinite());
    EXPECT_EQ(Eigen::LLT<Eigen::Matrix3d>(landmark.covariance.Matrix()).info(), Eigen::Success);
  }
}

TEST(SubmapRefiner, LandmarkWithoutParallaxHasLargeVarianceAlongItsRay) {
  SyntheticSubmapsOptions options;
  options.agents[0] = {0, 0.5, 1, 0.0};
  const SyntheticMission mission = MakeSyntheticMission(options);
  const auto refined = Refine(mission, 0);
  for (const RefinedLandmark& landmark : refined->landmarks) {
    const Eigen::Vector3d ray = landmark.point_in_submap.normalized();
    const double along = std::sqrt(landmark.covariance.SquareOf(ray));
    EXPECT_GT(along, 0.1 * landmark.point_in_submap.norm());
  }
}

TEST(SubmapRefiner, QuarantinesImplausibleSubmaps) {
  SyntheticSubmapsOptions options;
  options.agents[0].submaps = 1;
  options.agents[0].end_rad = 0.6;
  options.outlier_share = 0.7;
  EXPECT_NE(Refine(MakeSyntheticMission(options), 0)->quarantine_reason, "");
  options.outlier_share = 0;
  options.keyframes_per_submap = 1;
  EXPECT_THAT(Refine(MakeSyntheticMission(options), 0)->quarantine_reason, HasSubstr("keyframes"));
  options.keyframes_per_submap = 8;
  options.max_observations = 6;
  const auto refined = Refine(MakeSyntheticMission(options), 0);
  EXPECT_THAT(refined->quarantine_reason, HasSubstr("too few"));
  EXPECT_TRUE(refined->landmarks.empty());
}

TEST(SubmapRefiner, RepeatsToTheLastBit) {
  SyntheticSubmapsOptions options;
  options.agents[0].submaps = 1;
  options.agents[0].end_rad = 0.6;
  const SyntheticMission mission = MakeSyntheticMission(options);
  const auto first = Refine(mission, 0);
  const auto second = Refine(mission, 0);
  ASSERT_EQ(first->landmarks.size(), second->landmarks.size());
  for (size_t i = 0; i < first->landmarks.size(); ++i) {
    EXPECT_EQ(first->landmarks[i].point_in_submap, second->landmarks[i].point_in_submap);
  }
}

TEST(SubmapRefinerOptions, RefusesNonsense) {
  SubmapRefinerOptions options;
  EXPECT_TRUE(options.Validate().ok());
  options.min_inlier_share = 2;
  EXPECT_FALSE(SubmapRefiner::Create(options).ok());
  options = {};
  options.bundle.rounds = 0;
  EXPECT_FALSE(SubmapRefiner::Create(options).ok());
  options = {};
  options.triangulation.inlier_chi2 = -1;
  EXPECT_FALSE(SubmapRefiner::Create(options).ok());
}

}  // namespace
}  // namespace portolan
