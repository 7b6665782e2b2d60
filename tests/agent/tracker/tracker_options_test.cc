#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "agent/tracker/tracker.h"
#include "tests/agent/tracker/test_images.h"

namespace portolan {
namespace {

// 300 tracks in a small image would be nearer to each other than min_spacing_px.
TEST(Tracker, SmallImagesHaveFewerTracks) {
  TrackerOptions options;
  const auto count = [&options](int width, int height) {
    return (*Tracker::Create(options, TestCamera(width, height)))->max_points();
  };
  EXPECT_EQ(count(752, 480), options.max_points);
  EXPECT_NEAR(count(320, 240), 320 * 240 / (19.0 * 19.0), 40);
  options.max_points = 100;
  EXPECT_EQ(count(320, 240), 100);
}

TEST(TrackerOptions, RejectsNonsense) {
  const CameraModel camera = TestCamera(240, 180);
  EXPECT_TRUE(TrackerOptions().Validate().ok());
  for (const auto& spoil : std::vector<void (*)(TrackerOptions*)>{
           [](TrackerOptions* o) { o->max_points = 0; },
           [](TrackerOptions* o) { o->border_px = 2.0; },
           [](TrackerOptions* o) { o->gate_px = 0.0; },
           [](TrackerOptions* o) { o->min_spacing_px = 0.0; },
           [](TrackerOptions* o) { o->min_correlation = 1.5; },
           [](TrackerOptions* o) { o->min_reacquire_correlation = std::nan(""); },
           [](TrackerOptions* o) { o->pyramid_levels = 40; },
           [](TrackerOptions* o) { o->base_sigma_px = 0.0; },
           [](TrackerOptions* o) { o->max_lost = -1; },
           [](TrackerOptions* o) { o->search_sigma_px = 0.0; },
           [](TrackerOptions* o) { o->min_distance_share = 3.0; },
           [](TrackerOptions* o) { o->merge_distance_px = -1.0; },
           [](TrackerOptions* o) { o->detector.fast_threshold = 0; },
           [](TrackerOptions* o) { o->features.half_octaves = -1; }}) {
    TrackerOptions options;
    spoil(&options);
    EXPECT_EQ(Tracker::Create(options, camera).status().code(), absl::StatusCode::kInvalidArgument);
  }
}

}  // namespace
}  // namespace portolan
