#include "server/fusion/map_fuser.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <atomic>

#include "server/refinement/submap_refiner.h"
#include "tests/support/synthetic_submaps.h"

namespace portolan {
namespace {

class MapFuserTest : public ::testing::Test {
 protected:
  MapFuserTest() {
    SyntheticSubmapsOptions options;
    options.agents = {{0, 1.5, 3, 1.5}};
    mission_ = MakeSyntheticMission(options);
    const SubmapRefiner refiner = SubmapRefiner::Create({}).value();
    for (const SyntheticSubmap& submap : mission_.submaps) {
      aligner_.AddSubmap(refiner.Refine(submap.id, submap.submap, mission_.camera));
    }
  }

  SyntheticMission mission_;
  MapAligner aligner_{MapAlignerOptions()};
  const MapFuser fuser_{MapFuserOptions()};
};

TEST_F(MapFuserTest, SnapshotHoldsEverySubmapAndItsLandmarks) {
  const auto snapshot = fuser_.Fuse({}, &aligner_);
  EXPECT_EQ(snapshot->version, 1u);
  ASSERT_EQ(snapshot->submaps.size(), 3u);
  ASSERT_EQ(snapshot->components.size(), 1u);
  int landmarks = 0;
  for (const auto& state : snapshot->submaps) {
    EXPECT_EQ(state->world_from_camera.size(), state->refined->raw->keyframes.size());
    EXPECT_EQ(state->moved_at_version, 1u);
    LandmarkId previous(-1);
    for (const FusedLandmark& landmark : state->landmarks) {
      EXPECT_LT(previous, landmark.id);
      previous = landmark.id;
      EXPECT_EQ(landmark.sights.front().submap, state->refined->id);
      EXPECT_GE(landmark.observation_count, 3);
      EXPECT_EQ(Eigen::LLT<Eigen::Matrix3d>(landmark.covariance).info(), Eigen::Success);
      ++landmarks;
    }
  }
  EXPECT_GT(landmarks, 150);
}

TEST_F(MapFuserTest, UntouchedSubmapsAreShared) {
  const auto first = fuser_.Fuse({}, &aligner_);
  const auto second = fuser_.Fuse(*first, &aligner_);
  EXPECT_EQ(second->version, 2u);
  for (size_t i = 0; i < 3; ++i) EXPECT_EQ(first->submaps[i], second->submaps[i]);
}

TEST_F(MapFuserTest, LandmarkIdsAreStableAcrossSolves) {
  const auto before = fuser_.Fuse({}, &aligner_);
  const std::atomic<bool> never = false;
  while (aligner_.HasBackgroundWork()) aligner_.AdjustStaleComponent(never);
  const auto after = fuser_.Fuse(*before, &aligner_);
  size_t kept = 0;
  size_t total = 0;
  for (size_t i = 0; i < 3; ++i) {
    std::set<LandmarkId> ids;
    for (const auto& landmark : before->submaps[i]->landmarks) ids.insert(landmark.id);
    total += after->submaps[i]->landmarks.size();
    for (const auto& landmark : after->submaps[i]->landmarks) kept += ids.count(landmark.id);
  }
  EXPECT_GT(kept, 0.9 * static_cast<double>(total));
}

TEST_F(MapFuserTest, RestoredAlignerFusesTheSameMap) {
  const auto stored = fuser_.Fuse({}, &aligner_);
  MapAligner restored{MapAlignerOptions()};
  RestoreMap(*stored, &restored);
  restored.TakeTouched();
  const auto snapshot = fuser_.Fuse({}, &restored);
  ASSERT_EQ(snapshot->submaps.size(), 3u);
  for (size_t i = 0; i < 3; ++i) {
    const SubmapState& a = *stored->submaps[i];
    const SubmapState& b = *snapshot->submaps[i];
    EXPECT_EQ(a.component, b.component);
    EXPECT_EQ(a.world_from_camera.back().translation, b.world_from_camera.back().translation);
    ASSERT_EQ(a.landmarks.size(), b.landmarks.size());
    for (size_t k = 0; k < a.landmarks.size(); ++k) {
      EXPECT_EQ(a.landmarks[k].id, b.landmarks[k].id);
      EXPECT_EQ(a.landmarks[k].point_in_world, b.landmarks[k].point_in_world);
    }
  }
}

TEST_F(MapFuserTest, PoorLandmarksAreNotPublished) {
  MapFuserOptions strict;
  strict.max_relative_sigma = 1e-6;
  const auto snapshot = MapFuser(strict).Fuse({}, &aligner_);
  for (const auto& state : snapshot->submaps) EXPECT_TRUE(state->landmarks.empty());
}

TEST(MapFuserOptions, RefusesNonsense) {
  MapFuserOptions options;
  EXPECT_TRUE(options.Validate().ok());
  options.min_observations = 1;
  EXPECT_FALSE(options.Validate().ok());
}

}  // namespace
}  // namespace portolan
