// Tells a tracking failure from a bad frame, and when it began.
#ifndef PORTOLAN_AGENT_SUBMAP_TRACKING_HEALTH_H_
#define PORTOLAN_AGENT_SUBMAP_TRACKING_HEALTH_H_

#include <optional>

#include "common/base/status.h"
#include "common/base/time.h"

namespace portolan {

struct TrackingHealthOptions {
  // A frame with fewer inlier landmarks than this is bad.
  int min_inliers = 8;
  // This many bad frames in a row are a failure.
  int max_bad_frames = 4;
  // A pause longer than this cannot be bridged by prediction [s].
  double max_pause_s = 2.0;
  // After a pause longer than this [s] so many landmarks must be seen again as inliers: the few of
  // a new view that happen to fit carry neither pose nor scale over.
  double short_pause_s = 0.3;
  int min_inliers_after_pause = 15;

  Status Validate() const;
};

// Thread-compatible.
class TrackingHealth {
 public:
  explicit TrackingHealth(const TrackingHealthOptions& options) : options_(options) {}

  // Forgets everything: tracking starts anew.
  void Reset();

  // Reports a processed frame; pause: since the one before. Returns the time from which on the
  // submap is spoiled, if tracking has failed: the first of the bad frames.
  std::optional<Timestamp> Report(Timestamp time, Duration pause, int inliers, bool diverged);

  bool IsPauseTooLong(Duration pause) const { return ToSeconds(pause) > options_.max_pause_s; }

  bool last_frame_bad() const { return bad_frames_ > 0; }

 private:
  TrackingHealthOptions options_;
  int bad_frames_ = 0;
  Timestamp first_bad_time_{};
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_SUBMAP_TRACKING_HEALTH_H_
