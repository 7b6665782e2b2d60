#include "agent/submap/track_selection.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace portolan {
namespace {

// Track t is seen by the keyframes from first on, so many.
void AddTrack(uint32_t track, size_t first, size_t count, Submap* submap) {
  for (size_t k = first; k < first + count; ++k) {
    submap->keyframes[k].observations.push_back({TrackId(track), {10, 20}, 0.5f});
  }
}

std::vector<uint32_t> TracksOf(const Keyframe& keyframe) {
  std::vector<uint32_t> tracks;
  for (const Observation& observation : keyframe.observations) {
    tracks.push_back(observation.track.value());
  }
  return tracks;
}

TEST(TrackSelection, KeepsTheLongest) {
  Submap submap;
  submap.keyframes.resize(8);
  AddTrack(1, 0, 2, &submap);
  AddTrack(2, 0, 8, &submap);
  AddTrack(3, 0, 5, &submap);
  AddTrack(4, 5, 3, &submap);
  KeepLongestTracks(2, {}, &submap);
  EXPECT_THAT(TracksOf(submap.keyframes[0]), testing::ElementsAre(2, 3));
  EXPECT_THAT(TracksOf(submap.keyframes[7]), testing::ElementsAre(2, 4));
}

TEST(TrackSelection, PreferredOnesGoBeforeALittleLongerOnes) {
  Submap submap;
  submap.keyframes.resize(8);
  AddTrack(1, 0, 3, &submap);
  AddTrack(2, 0, 6, &submap);
  AddTrack(3, 0, 8, &submap);
  KeepLongestTracks(2, {TrackId(1)}, &submap);
  EXPECT_THAT(TracksOf(submap.keyframes[0]), testing::ElementsAre(1, 3));
}

TEST(TrackSelection, WhatIsTiedToATrackGoesWithIt) {
  Submap submap;
  submap.keyframes.resize(4);
  AddTrack(1, 0, 4, &submap);
  AddTrack(2, 0, 2, &submap);
  Feature of_1, of_2, of_none;
  of_1.track = TrackId(1);
  of_2.track = TrackId(2);
  submap.keyframes[0].features = {of_1, of_2, of_none};
  submap.landmarks.resize(2);
  submap.landmarks[0].track = TrackId(1);
  submap.landmarks[1].track = TrackId(2);
  KeepLongestTracks(1, {}, &submap);
  ASSERT_EQ(submap.keyframes[0].features.size(), 2u);
  EXPECT_EQ(submap.keyframes[0].features[0].track, TrackId(1));
  EXPECT_FALSE(submap.keyframes[0].features[1].track);
  ASSERT_EQ(submap.landmarks.size(), 1u);
  EXPECT_EQ(submap.landmarks[0].track, TrackId(1));
}

TEST(TrackSelection, FewTracksAllStay) {
  Submap submap;
  submap.keyframes.resize(3);
  AddTrack(1, 0, 1, &submap);
  AddTrack(2, 1, 2, &submap);
  KeepLongestTracks(5, {}, &submap);
  EXPECT_EQ(submap.keyframes[0].observations.size(), 1u);
  EXPECT_EQ(submap.keyframes[1].observations.size(), 1u);
}

}  // namespace
}  // namespace portolan
