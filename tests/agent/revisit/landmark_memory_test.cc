#include "agent/revisit/landmark_memory.h"

#include "tests/agent/revisit/wall_scene.h"
#include "tests/support/matchers.h"

namespace portolan {
namespace {

class LandmarkMemoryTest : public testing::Test {
 protected:
  // How far the landmarks are from the points that they are of, at worst.
  double WorstError(const KnownGroup& group, const Eigen::Vector3d& shift) const {
    double worst = 0;
    for (const KnownLandmark& landmark : group.landmarks) {
      double nearest = HUGE_VAL;
      for (const Eigen::Vector3d& point : scene_.points()) {
        nearest = std::min(nearest, (landmark.point_in_world - point - shift).norm());
      }
      worst = std::max(worst, nearest);
    }
    return worst;
  }

  const WallScene scene_;
  LandmarkMemory memory_{{}, scene_.camera()};
};

TEST_F(LandmarkMemoryTest, TriangulatesItsOwnSubmapsWhenTheyArePlaced) {
  memory_.AddSubmap(scene_.MakeSubmap(3));
  EXPECT_TRUE(memory_.groups().empty());
  memory_.Place(3, kWallWorld, kWallScale, scene_.Keyframes());
  ASSERT_EQ(memory_.groups().size(), 1u);
  const KnownGroup& group = memory_.groups().begin()->second;
  EXPECT_GT(group.landmarks.size(), 80u);
  EXPECT_LT(WorstError(group, Eigen::Vector3d::Zero()), 2e-3);
  for (const KnownLandmark& landmark : group.landmarks) {
    // 1.6 to either side at a distance of 4.5: along the ray known worse than across.
    EXPECT_LT(landmark.covariance(2, 2), 0.05 * 0.05);
    EXPECT_GT(landmark.covariance(2, 2), 2 * landmark.covariance(1, 1));
  }
}

TEST_F(LandmarkMemoryTest, OwnLandmarksMoveWithTheirKeyframe) {
  memory_.AddSubmap(scene_.MakeSubmap(3));
  memory_.Place(3, kWallWorld, kWallScale, scene_.Keyframes());
  std::vector<CorrectedKeyframe> moved = scene_.Keyframes();
  const Eigen::Vector3d shift(0.5, -1, 2);
  for (CorrectedKeyframe& keyframe : moved) keyframe.world_from_camera.translation += shift;
  memory_.Place(3, ComponentId(2), kWallScale, moved);
  const KnownGroup& group = memory_.groups().begin()->second;
  EXPECT_LT(WorstError(group, shift), 2e-3);
  const KnownLandmarkId first{{false, 3}, 0};
  EXPECT_TRUE(memory_.PositionOf(first, ComponentId(2)).has_value());
  EXPECT_FALSE(memory_.PositionOf(first, kWallWorld).has_value());
}

TEST_F(LandmarkMemoryTest, PlacementsOfUnknownSubmapsAreIgnored) {
  memory_.Place(3, kWallWorld, kWallScale, scene_.Keyframes());
  EXPECT_TRUE(memory_.groups().empty());
}

TEST_F(LandmarkMemoryTest, OffersGrowAndMoveTheirView) {
  memory_.AddOffer(scene_.MakeOffer(77, 0, 10));
  memory_.AddOffer(scene_.MakeOffer(77, 10, 5));
  const KnownGroup& group = memory_.groups().at({true, 77});
  EXPECT_EQ(group.landmarks.size(), 15u);
  EXPECT_LT(WorstError(group, Eigen::Vector3d::Zero()), 1e-9);
  LandmarkOffer moved = scene_.MakeOffer(77, 15, 0);
  moved.world_from_camera.translation = {1, 2, 3};
  memory_.AddOffer(moved);
  EXPECT_EQ(group.landmarks.size(), 15u);
  EXPECT_LT(WorstError(group, {1, 2, 3}), 1e-9);
}

TEST_F(LandmarkMemoryTest, LandmarksWithAGapBeforeThemAreLeftOut) {
  memory_.AddOffer(scene_.MakeOffer(77, 10, 5));
  EXPECT_TRUE(memory_.groups().empty());
  memory_.AddOffer(scene_.MakeOffer(77, 0, 5));
  memory_.AddOffer(scene_.MakeOffer(77, 10, 5));
  EXPECT_EQ(memory_.groups().at({true, 77}).landmarks.size(), 5u);
  // A server that knows of nothing begins anew.
  memory_.AddOffer(scene_.MakeOffer(77, 0, 3));
  EXPECT_EQ(memory_.groups().at({true, 77}).landmarks.size(), 3u);
}

TEST_F(LandmarkMemoryTest, AViewThatIsFilledAnewHasOtherLandmarks) {
  memory_.AddOffer(scene_.MakeOffer(77, 0, 5));
  const KnownLandmarkId before{{true, 77}, 2, memory_.groups().at({true, 77}).filling};
  memory_.AddOffer(scene_.MakeOffer(77, 5, 5));
  EXPECT_TRUE(memory_.PositionOf(before, kWallWorld).has_value());
  memory_.AddOffer(scene_.MakeOffer(77, 0, 5));
  EXPECT_FALSE(memory_.PositionOf(before, kWallWorld).has_value());
  const KnownLandmarkId after{{true, 77}, 2, memory_.groups().at({true, 77}).filling};
  EXPECT_TRUE(memory_.PositionOf(after, kWallWorld).has_value());
}

TEST_F(LandmarkMemoryTest, IsBounded) {
  LandmarkMemoryOptions options;
  options.max_submaps = 3;
  options.max_offered_views = 4;
  options.max_offered_landmarks = 20;
  LandmarkMemory memory(options, scene_.camera());
  for (uint32_t i = 0; i < 10; ++i) {
    memory.AddSubmap(scene_.MakeSubmap(i));
    memory.Place(i, kWallWorld, kWallScale, scene_.Keyframes());
    memory.AddOffer(scene_.MakeOffer(100 + i, 0, 30));
  }
  EXPECT_EQ(memory.groups().size(), 7u);
  EXPECT_TRUE(memory.groups().contains({false, 9}));
  EXPECT_TRUE(memory.groups().contains({true, 109}));
  EXPECT_EQ(memory.groups().at({true, 109}).landmarks.size(), 20u);
}

}  // namespace
}  // namespace portolan
