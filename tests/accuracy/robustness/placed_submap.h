// Recorded submaps placed by the ground truth: which of them show the same place?
#ifndef PORTOLAN_TESTS_ACCURACY_ROBUSTNESS_PLACED_SUBMAP_H_
#define PORTOLAN_TESTS_ACCURACY_ROBUSTNESS_PLACED_SUBMAP_H_

#include <memory>
#include <optional>
#include <vector>

#include "common/geometry/similarity3.h"
#include "common/trajectory/trajectory.h"
#include "server/refinement/refined_submap.h"

namespace portolan {

// A submap placed by the ground truth.
struct PlacedByTruth {
  std::shared_ptr<const RefinedSubmap> refined;
  Similarity3 world_from_submap;
  double depth_m = 1;  // median distance of its landmarks
  // Cosine between true and estimated motion in the first camera; about -1 where the filter and the
  // refinement took the depth-reversed solution.
  double motion_agreement = 0;
  std::vector<Rigid3> world_from_described;
};

// No value if the submap is quarantined or the ground truth does not cover it.
std::optional<PlacedByTruth> PlaceByTruth(std::shared_ptr<const RefinedSubmap> refined,
                                          const Trajectory& groundtruth);

// Described cameras within a quarter of the scene's depth and 20 degrees of each other.
bool IsNear(const PlacedByTruth& a, const PlacedByTruth& b);

// Not neighbours in one session (the map builder's default distance).
bool IsCandidate(const RefinedSubmap& a, const RefinedSubmap& b);

}  // namespace portolan

#endif  // PORTOLAN_TESTS_ACCURACY_ROBUSTNESS_PLACED_SUBMAP_H_
