// A trajectory: poses of one moving frame at ascending times. The moving frame is called `body`
// here; in a monocular map it is the camera's optical frame.
#ifndef PORTOLAN_COMMON_TRAJECTORY_TRAJECTORY_H_
#define PORTOLAN_COMMON_TRAJECTORY_TRAJECTORY_H_

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/time.h"
#include "common/geometry/rigid3.h"

namespace portolan {

struct StampedPose {
  Timestamp time{};
  // Lengths in metres, or in map units where the map is not metric.
  Rigid3 world_from_body;
};

// Strictly ascending in time once ValidateTrajectory accepts it.
using Trajectory = std::vector<StampedPose>;

// InvalidArgument, naming the entry, if a number is not finite, a quaternion is not of unit norm,
// or the times are not strictly ascending.
Status ValidateTrajectory(const Trajectory& trajectory);

// Sum of the distances between consecutive positions; the unit of the trajectory.
double PathLength(std::span<const StampedPose> trajectory);

// Path length from the first pose to each pose: one entry a pose, the first is 0.
std::vector<double> CumulativePathLength(std::span<const StampedPose> trajectory);

// Pose at `time`: linear in position, on the geodesic in rotation. No value outside of the
// trajectory's time span, or where the two neighbours are more than max_gap apart.
std::optional<Rigid3> InterpolatePose(const Trajectory& trajectory, Timestamp time,
                                      Duration max_gap = std::chrono::seconds(1));

// The trajectory at the given times; times without an interpolated pose are left out.
Trajectory ResampleTrajectory(const Trajectory& trajectory, std::span<const Timestamp> times,
                              Duration max_gap = std::chrono::seconds(1));

// Index pairs of two trajectories whose times are within max_difference of each other. Each index
// occurs once: of several candidates the nearest in time wins. Ascending.
struct IndexPair {
  size_t estimate = 0;
  size_t reference = 0;
};
std::vector<IndexPair> AssociateByTime(const Trajectory& estimate, const Trajectory& reference,
                                       Duration max_difference);

}  // namespace portolan

#endif  // PORTOLAN_COMMON_TRAJECTORY_TRAJECTORY_H_
