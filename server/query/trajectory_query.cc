#include "server/query/trajectory_query.h"

#include "common/submap/frame_correction.h"

namespace portolan {

std::vector<TimedPose> PosesOf(const SubmapState& state, bool all_frames,
                               std::optional<Timestamp> after) {
  const Submap& raw = *state.refined->raw;
  SubmapCorrection correction{state.world_from_submap, {}};
  std::vector<TimedPose> poses;
  for (size_t i = 0; i < raw.keyframes.size(); ++i) {
    const Keyframe& keyframe = raw.keyframes[i];
    correction.keyframes.push_back(
        {keyframe.time, keyframe.submap_from_camera, state.world_from_camera[i]});
    if (!all_frames && (!after || keyframe.time > *after)) {
      poses.push_back({keyframe.time, state.world_from_camera[i]});
    }
  }
  if (!all_frames) return poses;
  for (const FramePose& frame : raw.frames) {
    if (after && frame.time <= *after) continue;
    poses.push_back({frame.time, CorrectFrame(correction, frame.time, frame.submap_from_camera)});
  }
  return poses;
}

Rigid3 PlaceInSuccessor(const SubmapState& predecessor, const Rigid3& submap_from_camera) {
  return Similarity3::FromRigid(predecessor.world_from_camera.back(),
                                predecessor.world_from_submap.scale) *
         submap_from_camera;
}

}  // namespace portolan
