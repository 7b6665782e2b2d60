#include "agent/local_adjustment/live_localizer.h"

#include <utility>
#include <vector>

namespace portolan {

PlacedPose LiveLocalizer::Localize(const LiveFrame& frame, PoseCorrector* corrector) {
  if (frame.begins_submap) {
    if (frame.predecessor_from_submap) {
      odometry_from_submap_ = odometry_from_submap_ * *frame.predecessor_from_submap;
    } else {
      odometry_from_submap_ = Rigid3::Identity();
      window_.Start();
      window_.SetLens(added_radial_);
      held_.reset();
      followed_revision_ = 0;
    }
  }
  PlacedPose placed = corrector->Place(frame.sequence_number, frame.submap_from_camera);
  Learn(corrector);
  if (!frame.tracked) return placed;
  if (!frame.restated.empty()) {
    window_.Restate(odometry_from_submap_, frame.restated, last_located_);
  }
  FollowCorrections(frame.sequence_number, *corrector);
  last_located_ = frame.time;
  sights_.assign(frame.sights.begin(), frame.sights.end());
  const Rigid3 odometry_from_camera = odometry_from_submap_ * frame.submap_from_camera;
  row_motion_.Measure(frame.time, &sights_);
  if (last_keyframe_ && row_motion_.middle() == last_keyframe_) {
    for (const RowMotion::OfTrack& of_track : row_motion_.MeasureMiddle()) {
      window_.SetRowMotion(of_track.track, of_track.row_motion);
    }
  }
  Rigid3 pose = window_.Locate(odometry_from_camera, sights_);
  if (frame.is_keyframe) {
    last_keyframe_ = frame.time;
    std::vector<KnownSight> known;
    if (held_ && !frame.features.empty()) {
      matcher_.SetCamera(window_.camera());
      known =
          matcher_.Match(memory_, held_->component, frame.sequence_number, pose, frame.features);
    }
    const bool is_tied = !known.empty();
    window_.AddKeyframe(frame.time, std::move(known));
    if (is_tied) pose = window_.window_from_camera();
  }
  if (held_) {
    placed = *held_;
    placed.frame_from_camera = pose;
  } else if (!placed.in_world) {
    placed.frame_from_camera = pose;
  }
  return placed;
}

void LiveLocalizer::Learn(PoseCorrector* corrector) {
  if (!remembers_) return;
  const uint64_t revision = corrector->revision();
  if (revision != learnt_revision_) {
    for (const CorrectedSubmap& submap : corrector->PlacedSince(learnt_revision_)) {
      // The keyframes' poses are those of this lens.
      const auto camera = calibration_.WithRadial(submap.added_radial);
      if (camera.ok()) memory_.SetCamera(*camera);
      added_radial_ = submap.added_radial;
      memory_.Place(submap.origin.frame_submap, submap.origin.component, submap.scale,
                    submap.keyframes);
    }
    learnt_revision_ = revision;
  }
  for (const LandmarkOffer& offer : corrector->TakeOffers()) memory_.AddOffer(offer);
}

void LiveLocalizer::FollowCorrections(uint32_t sequence_number, const PoseCorrector& corrector) {
  const uint64_t revision = corrector.revision();
  if (revision == followed_revision_) return;
  followed_revision_ = revision;
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
  const auto position_of = [&](const KnownLandmarkId& landmark) {
    return memory_.PositionOf(landmark, newest->origin.component);
  };
  if (window_.Hold(poses, position_of)) {
    held_ = newest->origin;
  } else if (held_ && held_->component != newest->origin.component) {
    // The window's world is no more.
    held_.reset();
    window_.Start();
  }
}

}  // namespace portolan
