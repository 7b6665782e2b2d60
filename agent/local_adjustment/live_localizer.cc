#include "agent/local_adjustment/live_localizer.h"

#include <vector>

namespace portolan {

PlacedPose LiveLocalizer::Localize(const LiveFrame& frame, const PoseCorrector& corrector) {
  if (frame.begins_submap) {
    if (frame.predecessor_from_submap) {
      odometry_from_submap_ = odometry_from_submap_ * *frame.predecessor_from_submap;
    } else {
      odometry_from_submap_ = Rigid3::Identity();
      window_.Start();
      held_.reset();
      seen_version_ = 0;
    }
  }
  PlacedPose placed = corrector.Place(frame.sequence_number, frame.submap_from_camera);
  if (!frame.tracked) return placed;
  FollowCorrections(frame.sequence_number, corrector);
  const Rigid3 pose =
      window_.Locate(odometry_from_submap_ * frame.submap_from_camera, frame.sights);
  if (frame.is_keyframe) window_.AddKeyframe(frame.time);
  if (held_) {
    placed = *held_;
    placed.frame_from_camera = pose;
  } else if (!placed.in_world) {
    placed.frame_from_camera = pose;
  }
  return placed;
}

void LiveLocalizer::FollowCorrections(uint32_t sequence_number, const PoseCorrector& corrector) {
  const uint64_t version = corrector.map_version();
  if (version == seen_version_) return;
  seen_version_ = version;
  const std::optional<CorrectedSubmap> newest = corrector.NewestPlaced(sequence_number);
  if (!newest) return;
  if (held_ && newest->origin.frame_submap == held_->frame_submap &&
      newest->origin.map_version == held_->map_version) {
    return;
  }
  // The keyframes' poses are those of this lens.
  window_.SetLens(newest->added_radial);
  std::vector<LocalAdjustment::KeyframePose> poses;
  for (const CorrectedKeyframe& keyframe : newest->keyframes) {
    poses.push_back({keyframe.time, keyframe.world_from_camera});
  }
  if (window_.Hold(poses)) {
    held_ = newest->origin;
  } else if (held_ && held_->component != newest->origin.component) {
    // The window's world is no more.
    held_.reset();
    window_.Start();
  }
}

}  // namespace portolan
