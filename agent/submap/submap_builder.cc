#include "agent/submap/submap_builder.h"

#include <algorithm>
#include <utility>

#include "agent/submap/track_selection.h"
#include "common/base/check.h"

namespace portolan {
namespace {

void ScaleTranslation(double scale, Matrix6d* covariance) {
  covariance->topRows<3>() *= scale;
  covariance->leftCols<3>() *= scale;
}

}  // namespace

Status SubmapBuilderOptions::Validate() const {
  if (max_keyframes < 3 || max_keyframes > 64) {
    return absl::InvalidArgumentError("submap.max_keyframes must be within 3 and 64");
  }
  if (min_keyframes < 2 || min_keyframes > max_keyframes) {
    return absl::InvalidArgumentError("submap.min_keyframes must be within 2 and max_keyframes");
  }
  if (!(max_distance_depths > 0)) {
    return absl::InvalidArgumentError("submap.max_distance_depths must be > 0");
  }
  if (!(max_rotation_rad > 0)) {
    return absl::InvalidArgumentError("submap.max_rotation_rad must be > 0");
  }
  if (keyframes_per_description < 1) {
    return absl::InvalidArgumentError("submap.keyframes_per_description must be >= 1");
  }
  if (max_observations_per_keyframe < 20) {
    return absl::InvalidArgumentError("submap.max_observations_per_keyframe must be >= 20");
  }
  if (!(min_inverse_depth_sigmas > 0)) {
    return absl::InvalidArgumentError("submap.min_inverse_depth_sigmas must be > 0");
  }
  return absl::OkStatus();
}

void SubmapBuilder::Open(const SubmapKey& key, LinkType link) {
  submap_ = Submap();
  submap_.key = key;
  submap_.link = link;
  distance_ = 0;
  rotation_rad_ = 0;
}

void SubmapBuilder::AddFrame(Timestamp time, const Rigid3& submap_from_camera) {
  submap_.frames.push_back({time, submap_from_camera});
}

void SubmapBuilder::AddKeyframe(Timestamp time, const Rigid3& submap_from_camera,
                                const Matrix6d& covariance, const std::vector<TrackedPoint>& points,
                                std::vector<Feature> features) {
  if (!submap_.keyframes.empty()) {
    const Rigid3 step = submap_.keyframes.back().submap_from_camera.Inverse() * submap_from_camera;
    distance_ += step.translation.norm();
    rotation_rad_ += RotationLog(step.rotation).norm();
  }
  Keyframe keyframe;
  keyframe.time = time;
  keyframe.submap_from_camera = submap_from_camera;
  keyframe.covariance = covariance;
  keyframe.features = std::move(features);
  keyframe.observations.reserve(points.size());
  for (const TrackedPoint& point : points) {
    keyframe.observations.push_back(
        {point.track, point.pixel.cast<float>(), static_cast<float>(point.sigma_px)});
  }
  std::sort(keyframe.observations.begin(), keyframe.observations.end(),
            [](const Observation& a, const Observation& b) { return a.track < b.track; });
  submap_.keyframes.push_back(std::move(keyframe));
}

bool SubmapBuilder::NextIsDescribed() const {
  const int next = static_cast<int>(submap_.keyframes.size());
  return next >= 2 && (next - 2) % options_.keyframes_per_description == 0;
}

bool SubmapBuilder::IsFull(double median_depth) const {
  const int count = static_cast<int>(submap_.keyframes.size());
  if (count >= options_.max_keyframes) return true;
  if (count < options_.min_keyframes) return false;
  return distance_ > options_.max_distance_depths * median_depth ||
         rotation_rad_ > options_.max_rotation_rad;
}

void SubmapBuilder::Rescale(double scale) {
  distance_ *= scale;
  for (FramePose& frame : submap_.frames) frame.submap_from_camera.translation *= scale;
  for (Keyframe& keyframe : submap_.keyframes) {
    keyframe.submap_from_camera.translation *= scale;
    ScaleTranslation(scale, &keyframe.covariance);
  }
}

void SubmapBuilder::Restate(const std::vector<FramePose>& poses) {
  const std::vector<FramePose> before = submap_.frames;
  const auto old_pose = [&before](Timestamp time) {
    const auto it = std::lower_bound(
        before.begin(), before.end(), time,
        [](const FramePose& frame, Timestamp wanted) { return frame.time < wanted; });
    return it == before.end() ? before.back().submap_from_camera : it->submap_from_camera;
  };
  const auto move = [&](Timestamp time, Rigid3* pose) {
    const auto next = std::lower_bound(
        poses.begin(), poses.end(), time,
        [](const FramePose& frame, Timestamp wanted) { return frame.time < wanted; });
    if (next == poses.end()) return;
    if (next->time == time || next == poses.begin()) {
      *pose = next->submap_from_camera;
      return;
    }
    // In between the way is straight; the turn since the frame before is as it was seen.
    const FramePose& last = *std::prev(next);
    const double share = ToSeconds(time - last.time) / ToSeconds(next->time - last.time);
    const Eigen::Quaterniond turn = old_pose(last.time).rotation.conjugate() * pose->rotation;
    pose->rotation = (last.submap_from_camera.rotation * turn).normalized();
    pose->translation = (1 - share) * last.submap_from_camera.translation +
                        share * next->submap_from_camera.translation;
  };
  for (FramePose& frame : submap_.frames) move(frame.time, &frame.submap_from_camera);
  const double distance_before = std::exchange(distance_, 0);
  rotation_rad_ = 0;
  for (size_t i = 0; i < submap_.keyframes.size(); ++i) {
    Keyframe& keyframe = submap_.keyframes[i];
    move(keyframe.time, &keyframe.submap_from_camera);
    if (i == 0) continue;
    const Rigid3 step =
        submap_.keyframes[i - 1].submap_from_camera.Inverse() * keyframe.submap_from_camera;
    distance_ += step.translation.norm();
    rotation_rad_ += RotationLog(step.rotation).norm();
  }
  // Covariances before the smoothing are those of a motion that was less known, in its unit.
  if (!(distance_before > 0 && distance_ > distance_before)) return;
  for (Keyframe& keyframe : submap_.keyframes) {
    ScaleTranslation(distance_ / distance_before, &keyframe.covariance);
  }
}

Submap SubmapBuilder::Thinned(const std::vector<LandmarkEstimate>& landmarks) {
  std::unordered_set<TrackId> preferred = std::exchange(carried_, {});
  for (const LandmarkEstimate& landmark : landmarks) preferred.insert(landmark.track);
  KeepLongestTracks(options_.max_observations_per_keyframe, preferred, &submap_);
  if (!submap_.keyframes.empty()) {
    for (const Observation& observation : submap_.keyframes.back().observations) {
      carried_.insert(observation.track);
    }
  }
  return std::exchange(submap_, Submap());
}

Submap SubmapBuilder::Close(const std::vector<LandmarkEstimate>& landmarks) {
  for (const LandmarkEstimate& landmark : landmarks) {
    const bool depth_known =
        landmark.inverse_depth > options_.min_inverse_depth_sigmas * landmark.inverse_depth_sigma;
    if (depth_known) {
      submap_.landmarks.push_back({landmark.track, landmark.point_in_submap, landmark.covariance});
    }
  }
  std::sort(submap_.landmarks.begin(), submap_.landmarks.end(),
            [](const SubmapLandmark& a, const SubmapLandmark& b) { return a.track < b.track; });
  return Thinned(landmarks);
}

Submap SubmapBuilder::CloseBefore(Timestamp time) {
  auto& keyframes = submap_.keyframes;
  auto& frames = submap_.frames;
  while (!keyframes.empty() && keyframes.back().time >= time) keyframes.pop_back();
  while (!frames.empty() && frames.back().time >= time) frames.pop_back();
  return Thinned({});
}

}  // namespace portolan
