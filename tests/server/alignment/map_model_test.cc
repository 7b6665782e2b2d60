#include "server/alignment/map_model.h"

#include <gtest/gtest.h>

#include "server/refinement/submap_refiner.h"
#include "tests/support/synthetic_submaps.h"

namespace portolan {
namespace {

class MapModelTest : public ::testing::Test {
 protected:
  MapModelTest() {
    options_.agents = {{0, 1.2, 2, 1.5}, {0.2, 1.4, 2, 1.4}};
    mission_ = MakeSyntheticMission(options_);
    const SubmapRefiner refiner = SubmapRefiner::Create({}).value();
    for (const SyntheticSubmap& submap : mission_.submaps) {
      refined_.push_back(refiner.Refine(submap.id, submap.submap, mission_.camera));
    }
    // Ids 1 and 3 are the first agent's, 2 and 4 the second's.
    model_.Add(refined_[0], std::nullopt);
    model_.Add(refined_[1], std::nullopt);
    model_.Add(refined_[2], LinkToPredecessor({}, *refined_[0], *refined_[2]));
  }

  int LandmarkOf(SubmapId id, TrackId track) const {
    const ModelSubmap& submap = model_.submap(id);
    return submap.landmarks[MapModel::LandmarkIndex(*submap.refined, track)];
  }

  // Tracks of both agents that show the same point.
  std::pair<TrackId, TrackId> CommonPoint(int skip) const {
    for (const RefinedLandmark& a : refined_[0]->landmarks) {
      for (const RefinedLandmark& b : refined_[1]->landmarks) {
        if (mission_.point_ids_of_tracks[0].at(a.track) ==
                mission_.point_ids_of_tracks[1].at(b.track) &&
            skip-- == 0) {
          return {a.track, b.track};
        }
      }
    }
    return {};
  }

  SyntheticSubmapsOptions options_;
  SyntheticMission mission_;
  std::vector<std::shared_ptr<const RefinedSubmap>> refined_;
  MapModel model_{MapModelOptions()};
};

TEST_F(MapModelTest, LinkedSubmapsShareTracksAndAKeyframe) {
  EXPECT_EQ(model_.submap(SubmapId(3)).component, ComponentId(1));
  EXPECT_EQ(model_.submap(SubmapId(2)).component, ComponentId(2));
  EXPECT_EQ(model_.CameraOf(SubmapId(3), 0), std::make_pair(SubmapId(1), 9));
  int shared = 0;
  for (const RefinedLandmark& landmark : refined_[2]->landmarks) {
    if (FindLandmark(*refined_[0], landmark.track) == nullptr) continue;
    ++shared;
    EXPECT_EQ(LandmarkOf(SubmapId(1), landmark.track), LandmarkOf(SubmapId(3), landmark.track));
  }
  EXPECT_GT(shared, 20);
}

TEST_F(MapModelTest, SharedKeyframeIsCountedOnce) {
  for (const ModelLandmark& landmark : model_.landmarks()) {
    std::set<std::pair<SubmapId, int>> cameras;
    for (const LandmarkSight& sight : landmark.sights) {
      const ModelSubmap& submap = model_.submap(sight.submap);
      for (const ModelSight& s :
           submap.sights[MapModel::LandmarkIndex(*submap.refined, sight.track)]) {
        EXPECT_TRUE(cameras.insert(model_.CameraOf(sight.submap, s.keyframe)).second);
      }
    }
  }
}

TEST_F(MapModelTest, UnitesAndSeparates) {
  const auto [a, b] = CommonPoint(0);
  EXPECT_NE(LandmarkOf(SubmapId(1), a), LandmarkOf(SubmapId(2), b));
  EXPECT_TRUE(model_.UniteLandmarks({SubmapId(2), b}, {SubmapId(1), a}));
  const int united = LandmarkOf(SubmapId(1), a);
  EXPECT_EQ(united, LandmarkOf(SubmapId(2), b));
  EXPECT_EQ(model_.landmarks()[united].sights.front(), (LandmarkSight{SubmapId(1), a}));
  model_.SeparateLandmarks({SubmapId(1), SubmapId(2), SubmapId(3)});
  EXPECT_NE(LandmarkOf(SubmapId(1), a), LandmarkOf(SubmapId(2), b));
}

TEST_F(MapModelTest, PointsThatOneKeyframeSeesApartAreNotUnited) {
  const std::vector<Observation>& seen = refined_[0]->raw->keyframes[3].observations;
  std::vector<TrackId> tracks;
  for (const Observation& observation : seen) {
    if (FindLandmark(*refined_[0], observation.track) != nullptr)
      tracks.push_back(observation.track);
  }
  ASSERT_GE(tracks.size(), 2u);
  EXPECT_FALSE(model_.UniteLandmarks({SubmapId(1), tracks[0]}, {SubmapId(1), tracks[1]}));
  EXPECT_FALSE(model_.UniteLandmarks({SubmapId(1), tracks[0]}, {SubmapId(2), TrackId(999999)}));
}

TEST_F(MapModelTest, MovingAComponentKeepsItsShape) {
  const Similarity3 change{2.0, RotationExp({0.1, 0.2, 0.3}), {1, 2, 3}};
  const int landmark = model_.submap(SubmapId(1)).landmarks[5];
  const Eigen::Vector3d point = model_.landmarks()[landmark].point_in_world;
  const Rigid3 pose = model_.submap(SubmapId(3)).world_from_camera[4];
  model_.MoveComponent(ComponentId(1), ComponentId(2), change);
  EXPECT_EQ(model_.submap(SubmapId(3)).component, ComponentId(2));
  EXPECT_LT((model_.landmarks()[landmark].point_in_world - change * point).norm(), 1e-12);
  EXPECT_LT(
      (model_.submap(SubmapId(3)).world_from_camera[4].translation - change * pose.translation)
          .norm(),
      1e-12);
}

TEST_F(MapModelTest, SetCameraReachesBothSubmaps) {
  Rigid3 pose;
  pose.translation = {9, 9, 9};
  model_.SetCamera(SubmapId(1), 9, pose);
  EXPECT_EQ(model_.submap(SubmapId(3)).world_from_camera.front().translation, pose.translation);
}

}  // namespace
}  // namespace portolan
