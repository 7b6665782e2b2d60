// An agent's camera poses in the world, out of a version of the map.
#ifndef PORTOLAN_SERVER_QUERY_TRAJECTORY_QUERY_H_
#define PORTOLAN_SERVER_QUERY_TRAJECTORY_QUERY_H_

#include <optional>
#include <vector>

#include "common/base/time.h"
#include "server/fusion/map_state.h"

namespace portolan {

// A camera pose in the world.
struct TimedPose {
  Timestamp time{};
  Rigid3 world_from_camera;
};

// Poses of the submap's keyframes, or of every processed frame placed between its neighbouring
// keyframes, later than `after`: consecutive submaps share an image, which is told once.
std::vector<TimedPose> PosesOf(const SubmapState& state, bool all_frames,
                               std::optional<Timestamp> after);

// Where a camera at submap_from_camera in the not yet uploaded successor of `predecessor` is; the
// successor's base is the predecessor's last keyframe.
Rigid3 PlaceInSuccessor(const SubmapState& predecessor, const Rigid3& submap_from_camera);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_QUERY_TRAJECTORY_QUERY_H_
