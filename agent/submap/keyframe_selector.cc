#include "agent/submap/keyframe_selector.h"

#include <algorithm>

namespace portolan {
namespace {

double Median(std::vector<double>& values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<long>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// Accurate for the small angles in question, unlike acos of the dot product.
double AngleBetween(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

}  // namespace

Status KeyframeSelectorOptions::Validate() const {
  if (!(min_parallax_rad > 0)) return absl::InvalidArgumentError("min_parallax_rad must be > 0");
  if (!(min_flow_rad > 0)) return absl::InvalidArgumentError("min_flow_rad must be > 0");
  if (!(min_tracks_left >= 0 && min_tracks_left <= 1)) {
    return absl::InvalidArgumentError("min_tracks_left must be within 0 and 1");
  }
  if (!(min_interval_s >= 0 && min_interval_s <= max_interval_s)) {
    return absl::InvalidArgumentError("min_interval_s must be within 0 and max_interval_s");
  }
  if (!(moving_flow_rad >= 0)) return absl::InvalidArgumentError("moving_flow_rad must be >= 0");
  return absl::OkStatus();
}

void KeyframeSelector::SetKeyframe(Timestamp time, const Rigid3& submap_from_camera,
                                   const std::vector<TrackedPoint>& points) {
  keyframe_time_ = time;
  submap_from_keyframe_ = submap_from_camera;
  bearings_in_keyframe_.clear();
  for (const TrackedPoint& point : points) {
    if (const auto bearing = camera_.Unproject(point.pixel)) {
      bearings_in_keyframe_.emplace(point.track, *bearing);
    }
  }
}

TrackFlow KeyframeSelector::FlowSinceKeyframe(const Rigid3& submap_from_camera,
                                              const std::vector<TrackedPoint>& points) const {
  const Eigen::Quaterniond keyframe_from_camera =
      submap_from_keyframe_.rotation.conjugate() * submap_from_camera.rotation;
  std::vector<double> parallax, flow;
  for (const TrackedPoint& point : points) {
    const auto then = bearings_in_keyframe_.find(point.track);
    if (then == bearings_in_keyframe_.end()) continue;
    const auto now = camera_.Unproject(point.pixel);
    if (!now) continue;
    parallax.push_back(AngleBetween(then->second, keyframe_from_camera * *now));
    flow.push_back(AngleBetween(then->second, *now));
  }
  TrackFlow result;
  if (!bearings_in_keyframe_.empty()) {
    result.share_left =
        static_cast<double>(flow.size()) / static_cast<double>(bearings_in_keyframe_.size());
  }
  result.median_parallax_rad = Median(parallax);
  result.median_flow_rad = Median(flow);
  return result;
}

bool KeyframeSelector::IsDue(Timestamp time, const Rigid3& submap_from_camera,
                             const std::vector<TrackedPoint>& points) const {
  const TrackFlow flow = FlowSinceKeyframe(submap_from_camera, points);
  if (flow.share_left < options_.min_tracks_left) return true;
  const double interval_s = ToSeconds(time - keyframe_time_);
  if (interval_s < options_.min_interval_s) return false;
  if (flow.median_parallax_rad > options_.min_parallax_rad) return true;
  if (flow.median_flow_rad > options_.min_flow_rad) return true;
  return flow.median_flow_rad > options_.moving_flow_rad && interval_s > options_.max_interval_s;
}

}  // namespace portolan
