#include "agent/submap/tracking_health.h"

namespace portolan {

Status TrackingHealthOptions::Validate() const {
  if (min_inliers < 4) return absl::InvalidArgumentError("health.min_inliers must be at least 4");
  if (max_bad_frames < 1) {
    return absl::InvalidArgumentError("health.max_bad_frames must be at least 1");
  }
  if (!(max_pause_s > 0)) return absl::InvalidArgumentError("health.max_pause_s must be > 0");
  return absl::OkStatus();
}

void TrackingHealth::Reset() { bad_frames_ = 0; }

std::optional<Timestamp> TrackingHealth::Report(Timestamp time, int inliers, bool diverged) {
  const bool bad = diverged || inliers < options_.min_inliers;
  if (!bad) {
    bad_frames_ = 0;
    return std::nullopt;
  }
  if (bad_frames_++ == 0) first_bad_time_ = time;
  if (diverged || bad_frames_ >= options_.max_bad_frames) return first_bad_time_;
  return std::nullopt;
}

}  // namespace portolan
