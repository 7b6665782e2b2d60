// Decides when a frame becomes a keyframe.
#ifndef PORTOLAN_AGENT_SUBMAP_KEYFRAME_SELECTOR_H_
#define PORTOLAN_AGENT_SUBMAP_KEYFRAME_SELECTOR_H_

#include <unordered_map>

#include "agent/tracker/tracker.h"
#include "common/base/status.h"
#include "common/base/time.h"
#include "common/camera/camera_model.h"

namespace portolan {

struct KeyframeSelectorOptions {
  // Median angle between the sights of a track now and in the last keyframe, rotation removed
  // [rad]. 0.012 rad is 6 px at 500 px focal length: small enough that tracks live through
  // several keyframes, large enough that each adds parallax.
  double min_parallax_rad = 0.012;
  // Median angle with rotation left in [rad]: turning on the spot also needs keyframes, for the
  // tracks that enter and leave.
  double min_flow_rad = 0.10;
  // A keyframe is due when fewer than this share of the last keyframe's tracks is left.
  double min_tracks_left = 0.7;
  // Shortest time between keyframes [s], unless tracks are being lost: faster ones cost uplink and
  // server time for little parallax that the next one would not have.
  double min_interval_s = 0.09;
  // Longest time between keyframes while the camera moves [s].
  double max_interval_s = 1.0;
  // The camera moves if the median flow since the last keyframe exceeds this [rad].
  double moving_flow_rad = 0.008;

  Status Validate() const;
};

// Motion of the tracks since the last keyframe.
struct TrackFlow {
  double median_parallax_rad = 0;
  double median_flow_rad = 0;
  double share_left = 1;
};

// Thread-compatible.
class KeyframeSelector {
 public:
  KeyframeSelector(const KeyframeSelectorOptions& options, const CameraModel& camera)
      : options_(options), camera_(camera) {}

  // The frame is or becomes the last keyframe. submap_from_camera only removes the rotation.
  void SetKeyframe(Timestamp time, const Rigid3& submap_from_camera,
                   const std::vector<TrackedPoint>& points);
  // The last keyframe's pose has become known better.
  void MoveKeyframe(const Rigid3& submap_from_camera) {
    submap_from_keyframe_ = submap_from_camera;
  }

  bool IsDue(Timestamp time, const Rigid3& submap_from_camera,
             const std::vector<TrackedPoint>& points) const;

  TrackFlow FlowSinceKeyframe(const Rigid3& submap_from_camera,
                              const std::vector<TrackedPoint>& points) const;

 private:
  KeyframeSelectorOptions options_;
  CameraModel camera_;
  Timestamp keyframe_time_{};
  Rigid3 submap_from_keyframe_;
  std::unordered_map<TrackId, Eigen::Vector3d> bearings_in_keyframe_;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_SUBMAP_KEYFRAME_SELECTOR_H_
