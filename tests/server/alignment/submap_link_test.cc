#include "server/alignment/submap_link.h"

#include <gtest/gtest.h>

#include <cmath>

#include "server/refinement/submap_refiner.h"
#include "tests/support/synthetic_submaps.h"

namespace portolan {
namespace {

SubmapRelation LinkOfFirstTwo(const SyntheticMission& mission, const SubmapLinkOptions& options) {
  const SubmapRefiner refiner = SubmapRefiner::Create({}).value();
  const auto a = refiner.Refine(SubmapId(1), mission.submaps[0].submap, mission.camera);
  const auto b = refiner.Refine(SubmapId(2), mission.submaps[1].submap, mission.camera);
  return LinkToPredecessor(options, *a, *b);
}

TEST(SubmapLink, ScaleComesFromSharedLandmarks) {
  SyntheticSubmapsOptions options;
  options.scale_drift = 0.3;
  const SyntheticMission mission = MakeSyntheticMission(options);
  const SubmapRelation link = LinkOfFirstTwo(mission, {});
  const Similarity3 truth =
      mission.submaps[0].world_from_submap.Inverse() * mission.submaps[1].world_from_submap;
  EXPECT_GT(std::abs(std::log(truth.scale)), 0.05);
  EXPECT_NEAR(std::log(link.a_from_b.scale), std::log(truth.scale), 0.02);
  EXPECT_LT(link.a_from_b.rotation.angularDistance(truth.rotation), 0.01);
  EXPECT_LT((link.a_from_b.translation - truth.translation).norm(),
            0.03 * truth.translation.norm());
  EXPECT_EQ(Eigen::LLT<Matrix7d>(link.information).info(), Eigen::Success);
}

TEST(SubmapLink, MetricSubmapsHaveNearlyScaleOne) {
  SyntheticSubmapsOptions options;
  options.metric = true;
  const SubmapRelation link = LinkOfFirstTwo(MakeSyntheticMission(options), {});
  EXPECT_NEAR(std::log(link.a_from_b.scale), 0, 0.02);
}

TEST(SubmapLink, WithoutSharedLandmarksTheFilterIsBelieved) {
  const SyntheticMission mission = MakeSyntheticMission(SyntheticSubmapsOptions());
  const SubmapRefiner refiner = SubmapRefiner::Create({}).value();
  const auto a = refiner.Refine(SubmapId(1), mission.submaps[0].submap, mission.camera);
  RefinedSubmap b = *refiner.Refine(SubmapId(2), mission.submaps[1].submap, mission.camera);
  b.landmarks.clear();
  const SubmapLinkOptions options;
  const SubmapRelation link = LinkToPredecessor(options, *a, b);
  EXPECT_EQ(link.a_from_b.scale, 1.0);
  const Matrix7d covariance = link.information.inverse();
  EXPECT_NEAR(std::sqrt(covariance(6, 6)), options.carried_log_scale_sigma, 1e-9);
}

}  // namespace
}  // namespace portolan
