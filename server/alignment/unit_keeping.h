// The unit of a map when what solves it measures no lengths: solving it anew shall not change it,
// or poses that agents were told before would be in another unit than those after.
#ifndef PORTOLAN_SERVER_ALIGNMENT_UNIT_KEEPING_H_
#define PORTOLAN_SERVER_ALIGNMENT_UNIT_KEEPING_H_

#include <Eigen/Core>
#include <utility>
#include <vector>

#include "common/geometry/similarity3.h"

namespace portolan {

// Scales about the origin, a point that the solution has held, so that the median distance from it
// is as it was. moved: positions before and after. The one point or distance that a solution holds
// may be as wrong as others: starts are, and new submaps, which are often the farthest.
Similarity3 KeepUnit(const Eigen::Vector3d& origin,
                     const std::vector<std::pair<Eigen::Vector3d, Eigen::Vector3d>>& moved);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_ALIGNMENT_UNIT_KEEPING_H_
