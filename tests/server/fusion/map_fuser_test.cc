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

  // Compares the landmarks of a snapshot with what the model says now.
  int CountAsFusedAnew(const MapSnapshot& snapshot, const MapModel& model) const {
    int count = 0;
    for (const auto& state : snapshot.submaps) {
      const ModelSubmap& submap = model.submap(state->refined->id);
      EXPECT_EQ(state->world_from_submap.translation, submap.world_from_submap.translation);
      for (const FusedLandmark& landmark : state->landmarks) {
        const int index = MapModel::LandmarkIndex(*submap.refined, landmark.sights.front().track);
        const auto anew = fuser_.FuseLandmark(model, submap.landmarks[index]);
        if (!anew) continue;
        EXPECT_EQ(landmark.point_in_world, anew->point_in_world);
        EXPECT_EQ(landmark.sights, anew->sights);
        const Eigen::Matrix3d expected = anew->covariance.Matrix();
        EXPECT_LT((landmark.covariance.Matrix() - expected).norm(), 0.2 * expected.norm());
        ++count;
      }
    }
    return count;
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
      EXPECT_EQ(Eigen::LLT<Eigen::Matrix3d>(landmark.covariance.Matrix()).info(), Eigen::Success);
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

// In a large component relaxations move submaps whose landmarks are not fused anew.
TEST_F(MapFuserTest, LandmarksFollowSubmapsThatOnlyMove) {
  MapAlignerOptions options;
  options.full_component_submaps = 1;
  options.region_submaps = 1;
  options.settled_component_submaps = 1;
  options.relaxation.min_decrease = 0;
  MapAligner large(options);
  const SubmapRefiner refiner = SubmapRefiner::Create({}).value();
  for (const SyntheticSubmap& submap : mission_.submaps) {
    large.AddSubmap(refiner.Refine(submap.id, submap.submap, mission_.camera));
  }
  auto snapshot = fuser_.Fuse({}, &large);
  const std::atomic<bool> never = false;
  int moves = 0;
  for (int step = 0; step < 100 && large.HasBackgroundWork(); ++step) {
    large.AdjustStaleComponent(never);
    const Eigen::Vector3d before = snapshot->submaps[2]->world_from_submap.translation;
    snapshot = fuser_.Fuse(*snapshot, &large);
    if (snapshot->submaps[2]->world_from_submap.translation != before) ++moves;
    EXPECT_GT(CountAsFusedAnew(*snapshot, large.model()), 150);
  }
  EXPECT_GT(moves, 1);
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

// What redundant keyframes see is told, but makes no landmark of two views worth publishing.
TEST_F(MapFuserTest, RedundantSightsAreCountedButDoNotPublish) {
  const SubmapRefiner refiner = SubmapRefiner::Create({}).value();
  const SyntheticSubmap& first = mission_.submaps.front();
  RefinedSubmap refined = *refiner.Refine(first.id, first.submap, mission_.camera);
  for (RefinedLandmark& landmark : refined.landmarks) landmark.redundant_count = 100;
  MapAligner aligner{MapAlignerOptions()};
  aligner.AddSubmap(std::make_shared<const RefinedSubmap>(refined));
  MapFuserOptions strict;
  strict.min_observations = 8;
  const auto snapshot = MapFuser(strict).Fuse({}, &aligner);
  ASSERT_FALSE(snapshot->submaps.front()->landmarks.empty());
  EXPECT_LT(snapshot->submaps.front()->landmarks.size(), refined.landmarks.size() / 2);
  for (const FusedLandmark& landmark : snapshot->submaps.front()->landmarks) {
    EXPECT_GE(landmark.observation_count, 108);
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
