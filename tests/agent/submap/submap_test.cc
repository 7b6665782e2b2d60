#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "agent/submap/keyframe_selector.h"
#include "agent/submap/submap_builder.h"
#include "agent/submap/tracking_health.h"
#include "tests/support/matchers.h"
#include "tests/support/test_cameras.h"

namespace portolan {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::SizeIs;

// A wall of points two units before the start, seen from a pose.
std::vector<TrackedPoint> SeeWall(const CameraModel& camera, const Rigid3& world_from_camera) {
  std::vector<TrackedPoint> points;
  uint32_t id = 0;
  for (double y = -0.6; y < 0.7; y += 0.2) {
    for (double x = -0.8; x < 0.9; x += 0.2) {
      const TrackId track(id++);
      const auto pixel = camera.Project(world_from_camera.Inverse() * Eigen::Vector3d(x, y, 2));
      if (pixel && camera.IsInImage(*pixel)) points.push_back({track, *pixel, 0.5, 10});
    }
  }
  return points;
}

Rigid3 At(double x, double yaw_rad = 0) {
  return {RotationExp({0, yaw_rad, 0}), Eigen::Vector3d(x, 0, 0)};
}

class KeyframeSelectorTest : public ::testing::Test {
 protected:
  bool IsDue(double time_s, const Rigid3& pose) const {
    return selector_.IsDue(FromSeconds(time_s), pose, SeeWall(camera_, pose));
  }

  const CameraModel camera_ = PinholeTestCamera();
  KeyframeSelectorOptions options_;
  KeyframeSelector selector_{options_, camera_};

  void SetUp() override { selector_.SetKeyframe(Timestamp(0), At(0), SeeWall(camera_, At(0))); }
};

TEST_F(KeyframeSelectorTest, WantsParallaxFromTranslation) {
  // Two units away, 0.02 rad of parallax is 4 cm; the points beside the axis see a little less.
  EXPECT_FALSE(IsDue(0.1, At(0.9 * options_.min_parallax_rad * 2)));
  EXPECT_TRUE(IsDue(0.1, At(1.3 * options_.min_parallax_rad * 2)));
}

TEST_F(KeyframeSelectorTest, RotationAloneHasNoParallaxButFlow) {
  const Rigid3 turned = At(0, 0.05);
  const TrackFlow flow = selector_.FlowSinceKeyframe(turned, SeeWall(camera_, turned));
  EXPECT_LT(flow.median_parallax_rad, 1e-9);
  EXPECT_NEAR(flow.median_flow_rad, 0.05, 0.006);
  EXPECT_FALSE(IsDue(0.1, turned));
  EXPECT_TRUE(IsDue(0.1, At(0, 0.13)));
}

TEST_F(KeyframeSelectorTest, ReplacesLostTracks) {
  auto points = SeeWall(camera_, At(0));
  EXPECT_FALSE(selector_.IsDue(FromSeconds(0.1), At(0), points));
  points.resize(points.size() / 2);
  EXPECT_TRUE(selector_.IsDue(FromSeconds(0.1), At(0), points));
}

TEST_F(KeyframeSelectorTest, TimeCountsOnlyWhileMoving) {
  EXPECT_FALSE(IsDue(100, At(0)));
  const double moving = 1.3 * options_.moving_flow_rad * 2;
  EXPECT_FALSE(IsDue(0.5 * options_.max_interval_s, At(moving)));
  EXPECT_TRUE(IsDue(1.1 * options_.max_interval_s, At(moving)));
}

constexpr Duration kFrame = std::chrono::milliseconds(33);

TEST(TrackingHealth, FailsAfterBadFramesAndNamesTheFirst) {
  TrackingHealthOptions options;
  options.max_bad_frames = 3;
  TrackingHealth health(options);
  EXPECT_FALSE(health.Report(Timestamp(1), kFrame, 2, false));
  EXPECT_TRUE(health.last_frame_bad());
  EXPECT_FALSE(health.Report(Timestamp(2), kFrame, 30, false));
  EXPECT_FALSE(health.last_frame_bad());
  EXPECT_FALSE(health.Report(Timestamp(3), kFrame, 2, false));
  EXPECT_FALSE(health.Report(Timestamp(4), kFrame, 2, false));
  EXPECT_EQ(health.Report(Timestamp(5), kFrame, 2, false), Timestamp(3));
}

// The few landmarks of a new view that happen to fit carry nothing over.
TEST(TrackingHealth, FewLandmarksAfterAPauseFailAtOnce) {
  TrackingHealth health{TrackingHealthOptions()};
  constexpr Duration kPause = std::chrono::milliseconds(900);
  EXPECT_FALSE(health.Report(Timestamp(1), kPause, 20, false));
  EXPECT_FALSE(health.Report(Timestamp(2), kFrame, 10, false));
  EXPECT_EQ(health.Report(Timestamp(3), kPause, 10, false), Timestamp(3));
}

TEST(TrackingHealth, DivergenceFailsAtOnce) {
  TrackingHealth health{TrackingHealthOptions()};
  EXPECT_EQ(health.Report(Timestamp(9), kFrame, 50, true), Timestamp(9));
}

class SubmapBuilderTest : public ::testing::Test {
 protected:
  SubmapBuilderTest() { builder_.Open({AgentId("a"), SessionId(1), 3}, LinkType::kConnected); }

  void AddKeyframe(int index, std::vector<uint32_t> tracks) {
    std::vector<TrackedPoint> points;
    for (uint32_t track : tracks) points.push_back({TrackId(track), {10, 10}, 0.5, 1});
    const Rigid3 pose = At(0.01 * index);
    builder_.AddFrame(Timestamp(index), pose);
    builder_.AddKeyframe(Timestamp(index), pose, Matrix6d::Identity(), points, {});
  }

  SubmapBuilderOptions options_;
  SubmapBuilder builder_{options_};
};

TEST_F(SubmapBuilderTest, KeepsKeyAndSortsObservations) {
  AddKeyframe(0, {5, 2, 9});
  const Submap submap = builder_.Close({});
  EXPECT_EQ(submap.key.sequence_number, 3u);
  EXPECT_EQ(submap.link, LinkType::kConnected);
  ASSERT_THAT(submap.keyframes, SizeIs(1));
  const auto& observations = submap.keyframes[0].observations;
  ASSERT_THAT(observations, SizeIs(3));
  EXPECT_EQ(observations[0].track, TrackId(2));
  EXPECT_EQ(observations[2].track, TrackId(9));
}

TEST_F(SubmapBuilderTest, UploadsOnlyObservedLandmarksOfKnownDepth) {
  AddKeyframe(0, {1, 2});
  LandmarkEstimate good, deep, foreign;
  good.track = TrackId(1);
  good.inverse_depth = 0.5;
  good.inverse_depth_sigma = 0.05;
  deep = good;
  deep.track = TrackId(2);
  deep.inverse_depth_sigma = 0.3;
  foreign = good;
  foreign.track = TrackId(77);
  const Submap submap = builder_.Close({good, deep, foreign});
  ASSERT_THAT(submap.landmarks, SizeIs(1));
  EXPECT_EQ(submap.landmarks[0].track, TrackId(1));
}

TEST_F(SubmapBuilderTest, IsFullByKeyframesDistanceOrRotation) {
  AddKeyframe(0, {1});
  AddKeyframe(1, {1});
  AddKeyframe(2, {1});
  EXPECT_FALSE(builder_.IsFull(1.0));
  // 0.02 travelled so far.
  EXPECT_TRUE(builder_.IsFull(0.019 / options_.max_distance_depths));
  for (int i = 3; i < options_.max_keyframes; ++i) AddKeyframe(i, {1});
  EXPECT_TRUE(builder_.IsFull(1.0));
}

// Poses of every second frame, twice as far apart as they were thought.
TEST_F(SubmapBuilderTest, RestateMovesWhatLiesBetween) {
  for (int i = 0; i < 7; ++i) AddKeyframe(i, {1});
  builder_.Restate({{Timestamp(0), At(0)}, {Timestamp(2), At(0.04)}, {Timestamp(4), At(0.08)}});
  // The distance is that of the new poses: 0.08, back to 0.05 and on to 0.06.
  EXPECT_TRUE(builder_.IsFull(0.119 / options_.max_distance_depths));
  EXPECT_FALSE(builder_.IsFull(0.121 / options_.max_distance_depths));
  const Submap submap = builder_.Close({});
  for (int i = 0; i < 7; ++i) {
    const double x = i <= 4 ? 0.02 * i : 0.01 * i;  // those after the last pose stay
    EXPECT_THAT(submap.frames[i].submap_from_camera, NearRigid(At(x), 1e-9)) << i;
    EXPECT_THAT(submap.keyframes[i].submap_from_camera, NearRigid(At(x), 1e-9)) << i;
    // No longer than 0.06 before, 0.12 now: in the new unit as unsure as they were.
    EXPECT_NEAR(submap.keyframes[i].covariance(0, 0), 4, 1e-9);
    EXPECT_NEAR(submap.keyframes[i].covariance(3, 3), 1, 1e-9);
  }
}

TEST_F(SubmapBuilderTest, DescribesEveryNthKeyframe) {
  std::vector<int> described;
  for (int i = 0; i < 12; ++i) {
    if (builder_.NextIsDescribed()) described.push_back(i);
    AddKeyframe(i, {1});
  }
  EXPECT_THAT(described, ElementsAre(2, 2 + options_.keyframes_per_description));
}

TEST_F(SubmapBuilderTest, CloseBeforeDropsWhatTheFailureSpoiled) {
  for (int i = 0; i < 6; ++i) AddKeyframe(i, {1});
  const Submap submap = builder_.CloseBefore(Timestamp(4));
  EXPECT_THAT(submap.keyframes, SizeIs(4));
  EXPECT_THAT(submap.frames, SizeIs(4));
  EXPECT_THAT(submap.landmarks, IsEmpty());
  EXPECT_EQ(submap.keyframes.back().time, Timestamp(3));
}

// What linked this submap to the last one is worth four sights, so that both ends of it are sent.
TEST_F(SubmapBuilderTest, KeepsTheLongestTracksAndThoseThatLink) {
  options_.max_observations_per_keyframe = 2;
  builder_ = SubmapBuilder(options_);
  const auto tracks_of = [](const Submap& submap, size_t keyframe) {
    std::vector<uint32_t> tracks;
    for (const Observation& observation : submap.keyframes[keyframe].observations) {
      tracks.push_back(observation.track.value());
    }
    return tracks;
  };
  builder_.Open({AgentId("a"), SessionId(1), 0}, LinkType::kConnected);
  AddKeyframe(0, {1, 2, 3});
  AddKeyframe(1, {2, 3, 7});
  const Submap first = builder_.Close({});
  EXPECT_THAT(tracks_of(first, 0), ElementsAre(2, 3));
  EXPECT_THAT(tracks_of(first, 1), ElementsAre(2, 3));
  builder_.Open({AgentId("a"), SessionId(1), 1}, LinkType::kConnected);
  AddKeyframe(1, {3, 7, 8, 9});
  for (int i = 2; i < 5; ++i) AddKeyframe(i, {8, 9});
  const Submap second = builder_.Close({});
  EXPECT_THAT(tracks_of(second, 0), ElementsAre(3, 8));
  EXPECT_THAT(tracks_of(second, 1), ElementsAre(8));
}

}  // namespace
}  // namespace portolan
