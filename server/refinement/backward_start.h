// Another start for the adjustment of a submap whose filter went wrong in its beginning.
#ifndef PORTOLAN_SERVER_REFINEMENT_BACKWARD_START_H_
#define PORTOLAN_SERVER_REFINEMENT_BACKWARD_START_H_

#include <optional>
#include <vector>

#include "common/bundle/bundle_options.h"
#include "common/bundle/bundle_problem.h"
#include "common/bundle/triangulation.h"

namespace portolan {

// A filter that starts without knowing either depths or motion may take turn for translation for a
// while and find out later; its landmarks are those of the end. So the cameras are placed anew from
// the last to the first: each by resection from the points that the later ones have placed, from
// the pose of the next one or, if that fails, with the filter's motion (near the end that alone
// will do); then what it sees together with them is triangulated.
//
// `problem` holds the filter's camera poses and all observations, grouped by point; `known` what
// the filter says of the points. Returns the poses in the frame of the first camera; no value if
// one of them sees too little of what is known.
std::optional<std::vector<Rigid3>> StartBackward(
    const BundleProblem& problem, const std::vector<std::optional<Eigen::Vector3d>>& known,
    const BundleOptions& bundle, const TriangulationOptions& triangulation, double scene_depth);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_REFINEMENT_BACKWARD_START_H_
