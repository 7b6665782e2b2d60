#include "agent/submap/submap_budget.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <map>

#include "common/wire/submap_wire.h"
#include "tests/common/wire/random_submap.h"
#include "tests/support/matchers.h"

namespace portolan {
namespace {

size_t FeatureCount(const Submap& submap) {
  size_t count = 0;
  for (const Keyframe& keyframe : submap.keyframes) count += keyframe.features.size();
  return count;
}

// 4.5 s with 800 described points. Their descriptors are random, so that the encoded size says
// nothing of images.
Submap NextSubmap(int number) {
  Submap submap = RandomSubmap({.sequence_number = static_cast<uint32_t>(number)});
  for (Keyframe& keyframe : submap.keyframes) {
    keyframe.time += number * std::chrono::milliseconds(4500);
  }
  return submap;
}

TEST(SubmapBudget, LeavesSubmapsAloneThatFit) {
  SubmapBudget budget({});
  for (int i = 0; i < 20; ++i) {
    Submap submap = NextSubmap(i);
    EXPECT_EQ(budget.Fit(&submap), 0);
    EXPECT_EQ(FeatureCount(submap), 800u);
  }
}

TEST(SubmapBudget, KeepsTheLongTermRateOnceTheBurstIsUsed) {
  const SubmapBudgetOptions options{.bytes_per_second = 4'500};
  SubmapBudget budget(options);
  double bytes = 0;
  constexpr int kSubmaps = 20;
  for (int i = 0; i < kSubmaps; ++i) {
    Submap submap = NextSubmap(i);
    const int left_out = budget.Fit(&submap);
    EXPECT_EQ(FeatureCount(submap) + static_cast<size_t>(left_out), 800u);
    EXPECT_GE(FeatureCount(submap), 200u);
    bytes += EstimateSubmapBytes(submap);
  }
  EXPECT_LE(bytes, options.burst_bytes + options.bytes_per_second * 4.5 * kSubmaps);
  EXPECT_GT(bytes, 0.9 * options.bytes_per_second * 4.5 * kSubmaps);
}

TEST(SubmapBudget, CornersGoFirstThenShortTracks) {
  Submap submap = NextSubmap(0);
  std::map<TrackId, int> sights;
  for (const Keyframe& keyframe : submap.keyframes) {
    for (const Observation& observation : keyframe.observations) ++sights[observation.track];
  }
  const auto least_worth = [&] {
    int least = 1000;
    for (const Keyframe& keyframe : submap.keyframes) {
      for (const Feature& feature : keyframe.features) {
        least = std::min(least, feature.track ? sights[*feature.track] : 0);
      }
    }
    return least;
  };
  ASSERT_EQ(least_worth(), 0);
  SubmapBudget budget({.bytes_per_second = 1, .burst_bytes = 0, .min_features = 150});
  EXPECT_EQ(budget.Fit(&submap), 650);
  // Two thirds of the points are on no track.
  EXPECT_GT(least_worth(), 1);
}

TEST(SubmapBudget, ShortTracksGoBeforeDescribedPoints) {
  Submap submap;
  submap.keyframes.resize(10);
  for (uint32_t track = 0; track < 300; ++track) {
    // Every third one is seen by all keyframes, the others by three.
    const size_t first = track % 3 == 0 ? 0 : track % 8;
    for (size_t k = first; k < (track % 3 == 0 ? 10 : first + 3); ++k) {
      submap.keyframes[k].observations.push_back({TrackId(track), {1, 2}, 0.5f});
    }
  }
  submap.keyframes[2].features.resize(300);
  const size_t short_track = submap.keyframes[5].observations.size();
  ASSERT_GT(short_track, 150u);
  SubmapBudget budget({.bytes_per_second = 1,
                       .burst_bytes = EstimateSubmapBytes(submap) - 1000,
                       .min_observations = 120});
  EXPECT_EQ(budget.Fit(&submap), 0);
  for (const Keyframe& keyframe : submap.keyframes) {
    int long_tracks = 0;
    for (const Observation& observation : keyframe.observations) {
      long_tracks += observation.track.value() % 3 == 0 ? 1 : 0;
    }
    EXPECT_EQ(long_tracks, 100);
  }
  EXPECT_LT(submap.keyframes[5].observations.size(), short_track);
}

// Of tracks that are equally long those without landmarks go.
TEST(SubmapBudget, TracksOfLandmarksStay) {
  Submap submap;
  submap.keyframes.resize(10);
  for (uint32_t track = 0; track < 300; ++track) {
    for (Keyframe& keyframe : submap.keyframes) {
      keyframe.observations.push_back({TrackId(track), {1, 2}, 0.5f});
    }
    if (track >= 250) submap.landmarks.push_back({TrackId(track)});
  }
  SubmapBudget budget({.bytes_per_second = 1,
                       .burst_bytes = EstimateSubmapBytes(submap) - 1000,
                       .min_observations = 120});
  EXPECT_EQ(budget.Fit(&submap), 0);
  EXPECT_LT(submap.keyframes[0].observations.size(), 300u);
  EXPECT_EQ(submap.landmarks.size(), 50u);
}

TEST(SubmapBudget, ZeroIsNoLimit) {
  SubmapBudget budget({.bytes_per_second = 0, .burst_bytes = 0});
  Submap submap = NextSubmap(0);
  EXPECT_EQ(budget.Fit(&submap), 0);
}

TEST(SubmapBudget, EstimateIsNearTheEncodedSizeWithoutDescriptors) {
  const Submap submap = RandomSubmap({.features = 0});
  const double bytes = static_cast<double>(EncodeSubmap(submap).value_or("").size());
  EXPECT_NEAR(EstimateSubmapBytes(submap) / bytes, 1, 0.15);
}

TEST(SubmapBudget, RefusesNonsense) {
  EXPECT_THAT(SubmapBudgetOptions().Validate(), IsOk());
  EXPECT_FALSE(SubmapBudgetOptions{.bytes_per_second = -1}.Validate().ok());
  EXPECT_FALSE(SubmapBudgetOptions{.burst_bytes = -1}.Validate().ok());
  EXPECT_FALSE(SubmapBudgetOptions{.min_features = -1}.Validate().ok());
}

}  // namespace
}  // namespace portolan
