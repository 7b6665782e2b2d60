#include "agent/landmarks/landmark_manager.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/test_cameras.h"

namespace portolan {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::SizeIs;

TrackedPoint Point(uint32_t id, double x, double y, int age = 10) {
  return {TrackId(id), {x, y}, 0.5, age};
}

class LandmarkManagerTest : public ::testing::Test {
 protected:
  LandmarkManagerOptions options_;
  LandmarkManager manager_{options_, PinholeTestCamera()};
};

TEST_F(LandmarkManagerTest, SpreadsLandmarksOverTheImage) {
  // A cluster of old tracks in one corner and young ones everywhere else.
  std::vector<TrackedPoint> points;
  for (uint32_t i = 0; i < 100; ++i) points.push_back(Point(i, 5 + i % 10, 5 + i / 10, 50));
  for (uint32_t i = 0; i < 60; ++i) {
    points.push_back(Point(200 + i, 32 + 64 * (i % 10), 40 + 80 * (i / 10)));
  }
  const auto chosen = manager_.Choose(points, 0, false);
  EXPECT_THAT(chosen, SizeIs(static_cast<size_t>(options_.target_landmarks)));
  int in_cluster = 0;
  for (TrackId track : chosen) in_cluster += track.value() < 100 ? 1 : 0;
  EXPECT_LE(in_cluster, 3);
}

TEST_F(LandmarkManagerTest, TakesYoungTracksOnlyAtAStart) {
  const std::vector<TrackedPoint> points = {Point(1, 10, 10, 0), Point(2, 300, 200, 9)};
  EXPECT_THAT(manager_.Choose(points, 0, false), ElementsAre(TrackId(2)));
  EXPECT_THAT(manager_.Choose(points, 0, true), ElementsAre(TrackId(1), TrackId(2)));
  EXPECT_THAT(manager_.Choose(points, options_.target_landmarks, true), IsEmpty());
}

TEST_F(LandmarkManagerTest, DropsRepeatedOutliersWithTheirTracks) {
  manager_.Add({TrackId(1)});
  UpdateResult update;
  update.outliers = {TrackId(1)};
  EXPECT_THAT(manager_.Report({}, update).tracks, IsEmpty());
  EXPECT_TRUE(manager_.WasOutlier(TrackId(1)));
  const LandmarkRemovals removals = manager_.Report({}, update);
  EXPECT_THAT(removals.tracks, ElementsAre(TrackId(1)));
  EXPECT_THAT(removals.landmarks, ElementsAre(TrackId(1)));
}

TEST_F(LandmarkManagerTest, OneInlierFrameForgivesAnOutlier) {
  manager_.Add({TrackId(1)});
  UpdateResult outlier, inlier;
  outlier.outliers = {TrackId(1)};
  inlier.inliers = {TrackId(1)};
  for (int i = 0; i < 5; ++i) {
    EXPECT_THAT(manager_.Report({}, outlier).tracks, IsEmpty());
    manager_.Report({}, inlier);
    EXPECT_FALSE(manager_.WasOutlier(TrackId(1)));
  }
}

TEST_F(LandmarkManagerTest, DropsLandmarksThatShouldBeVisibleButAreNot) {
  manager_.Add({TrackId(1), TrackId(2)});
  PredictedMeasurement visible;
  visible.track = TrackId(1);
  std::vector<TrackId> dropped;
  int frames = 0;
  while (dropped.empty() && frames < 100) {
    ++frames;
    dropped = manager_.Report({visible}, UpdateResult()).landmarks;
  }
  EXPECT_EQ(frames, options_.max_missed_frames + 1);
  EXPECT_THAT(dropped, ElementsAre(TrackId(1)));
}

TEST_F(LandmarkManagerTest, MakesRoomByTheLongestUnseen) {
  std::vector<TrackId> all;
  for (int i = 0; i < options_.max_landmarks; ++i) all.push_back(TrackId(static_cast<uint32_t>(i)));
  manager_.Add(all);
  UpdateResult update;
  // Track 7 stays unseen for three frames, track 3 for one.
  for (int frame = 0; frame < 3; ++frame) {
    update.inliers.clear();
    for (TrackId track : all) {
      const bool unseen = track == TrackId(7) || (track == TrackId(3) && frame == 2);
      if (!unseen) update.inliers.push_back(track);
    }
    manager_.Report({}, update);
  }
  EXPECT_THAT(manager_.MakeRoomFor(1), ElementsAre(TrackId(7)));
  EXPECT_THAT(manager_.MakeRoomFor(5), ElementsAre(TrackId(7), TrackId(3)));
}

}  // namespace
}  // namespace portolan
