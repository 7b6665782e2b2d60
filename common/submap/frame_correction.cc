#include "common/submap/frame_correction.h"

#include <algorithm>

namespace portolan {
namespace {

// world_from_submap as this one keyframe sees it: maps its filter pose onto its adjusted pose.
Similarity3 WorldFromSubmapAt(const CorrectedKeyframe& keyframe, double scale) {
  return Similarity3::FromRigid(keyframe.world_from_camera, scale) *
         Similarity3::FromRigid(keyframe.submap_from_camera).Inverse();
}

}  // namespace

Rigid3 CorrectFrame(const SubmapCorrection& correction, Timestamp time,
                    const Rigid3& submap_from_camera) {
  const auto& keyframes = correction.keyframes;
  if (keyframes.empty()) return correction.world_from_submap * submap_from_camera;
  const double scale = correction.world_from_submap.scale;
  const auto after = std::lower_bound(
      keyframes.begin(), keyframes.end(), time,
      [](const CorrectedKeyframe& keyframe, Timestamp t) { return keyframe.time < t; });
  if (after == keyframes.begin()) {
    return WorldFromSubmapAt(keyframes.front(), scale) * submap_from_camera;
  }
  if (after == keyframes.end()) {
    return WorldFromSubmapAt(keyframes.back(), scale) * submap_from_camera;
  }
  // Both corrections act on this frame; the geodesic between the two placements.
  const Rigid3 from = WorldFromSubmapAt(*std::prev(after), scale) * submap_from_camera;
  const Rigid3 to = WorldFromSubmapAt(*after, scale) * submap_from_camera;
  const double fraction = ToSeconds(time - std::prev(after)->time) /
                          ToSeconds(after->time - std::prev(after)->time);
  return from * Rigid3::Exp(fraction * (from.Inverse() * to).Log());
}

}  // namespace portolan
