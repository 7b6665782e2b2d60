#include "agent/submap/tracking_health.h"

namespace portolan {

Status TrackingHealthOptions::Validate() const {
  if (min_inliers < 4) return absl::InvalidArgumentError("health.min_inliers must be at least 4");
  if (max_bad_frames < 1) {
    return absl::InvalidArgumentError("health.max_bad_frames must be at least 1");
  }
  if (!(max_pause_s > 0)) return absl::InvalidArgumentError("health.max_pause_s must be > 0");
  if (!(short_pause_s > 0) || min_inliers_after_pause < 0) {
    return absl::InvalidArgumentError(
        "health.short_pause_s must be > 0, health.min_inliers_after_pause not negative");
  }
  return absl::OkStatus();
}

void TrackingHealth::Reset() { bad_frames_ = 0; }

std::optional<Timestamp> TrackingHealth::Report(Timestamp time, Duration pause, int inliers,
                                                bool diverged) {
  const bool lost_in_pause =
      ToSeconds(pause) > options_.short_pause_s && inliers < options_.min_inliers_after_pause;
  const bool bad = diverged || lost_in_pause || inliers < options_.min_inliers;
  if (!bad) {
    bad_frames_ = 0;
    return std::nullopt;
  }
  if (bad_frames_++ == 0) first_bad_time_ = time;
  if (diverged || lost_in_pause || bad_frames_ >= options_.max_bad_frames) return first_bad_time_;
  return std::nullopt;
}

}  // namespace portolan
