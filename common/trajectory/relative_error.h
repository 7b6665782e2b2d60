// Relative pose errors over path lengths, times and KITTI segments, from matched poses.
#ifndef PORTOLAN_COMMON_TRAJECTORY_RELATIVE_ERROR_H_
#define PORTOLAN_COMMON_TRAJECTORY_RELATIVE_ERROR_H_

#include <span>
#include <vector>

#include "common/trajectory/trajectory.h"

namespace portolan {

// An estimated pose, its lengths already in the reference's unit, beside the reference pose of
// the same time. path_m is the reference's path length up to it.
struct MatchedPose {
  Timestamp time{};
  Rigid3 estimate;
  Rigid3 reference;
  double path_m = 0;
};

// Rates over all intervals that start at any pose and end at the first pose at least `length`
// later (metres of reference path, or seconds); intervals longer than 1.5 times that, which span a
// gap, are left out. Each rate is divided by the interval's own length.
struct RelativeRates {
  std::vector<double> translation;
  std::vector<double> rotation_rad;
};
RelativeRates RatesPerMetre(std::span<const MatchedPose> poses, double length_m);
RelativeRates RatesPerSecond(std::span<const MatchedPose> poses, double length_s);

// Segments of 100, 200, ..., 800 m that start at every tenth pose and end at the first pose beyond
// that length; errors over the nominal length, as in the benchmark's own program.
RelativeRates KittiSegments(std::span<const MatchedPose> poses);

}  // namespace portolan

#endif  // PORTOLAN_COMMON_TRAJECTORY_RELATIVE_ERROR_H_
