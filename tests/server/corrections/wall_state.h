// A submap before a wall of well known landmarks, its first keyframe described.
#ifndef PORTOLAN_TESTS_SERVER_CORRECTIONS_WALL_STATE_H_
#define PORTOLAN_TESTS_SERVER_CORRECTIONS_WALL_STATE_H_

#include <memory>
#include <string>

#include "server/fusion/map_state.h"

namespace portolan::testing {

inline constexpr int kWallLandmarks = 60;

// The submap 0 of the agent's session 1, two world units a unit, that lies at world_from_camera and
// sees points at a distance of 4 to 6 in the world.
std::shared_ptr<const SubmapState> MakeWallState(const std::string& agent, int64_t id,
                                                 const Rigid3& world_from_camera);

}  // namespace portolan::testing

#endif  // PORTOLAN_TESTS_SERVER_CORRECTIONS_WALL_STATE_H_
