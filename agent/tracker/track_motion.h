// Where tracks went: from neighbours to those that were not found.
#ifndef PORTOLAN_AGENT_TRACKER_TRACK_MOTION_H_
#define PORTOLAN_AGENT_TRACKER_TRACK_MOTION_H_

#include <Eigen/Core>
#include <optional>
#include <vector>

namespace portolan {

// How a track moved beyond the camera's rotation.
struct TrackMotion {
  Eigen::Vector2d from;
  Eigen::Vector2d shift;
};

// Median motion of the nearest tracks; no value if there are too few.
std::optional<Eigen::Vector2d> LocalMotion(const std::vector<TrackMotion>& motions,
                                           const Eigen::Vector2d& pixel);

}  // namespace portolan

#endif  // PORTOLAN_AGENT_TRACKER_TRACK_MOTION_H_
