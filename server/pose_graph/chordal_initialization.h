// Start values for a pose graph that do not depend on the poses it came with.
//
// Rotations by chordal relaxation: the orthogonality constraints are dropped, which leaves a
// linear least squares problem for the rotation matrices, and the solution is projected back
// (Carlone, Tron, Daniilidis, Dellaert, "Initialization techniques for 3D SLAM", ICRA 2015,
// Sec. III-C). Translations then follow from a second linear problem.
#ifndef PORTOLAN_SERVER_POSE_GRAPH_CHORDAL_INITIALIZATION_H_
#define PORTOLAN_SERVER_POSE_GRAPH_CHORDAL_INITIALIZATION_H_

#include <vector>

#include "common/base/status.h"
#include "server/pose_graph/pose_graph.h"

namespace portolan {

// Replaces all poses but those of `anchors` (one node for each connected part at least, else
// FailedPrecondition). An edge counts with the mean of its rotational and of its translational
// information.
Status InitializeChordal(const std::vector<int>& anchors, PoseGraph3& graph);
Status InitializeChordal(const std::vector<int>& anchors, PoseGraph2& graph);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_POSE_GRAPH_CHORDAL_INITIALIZATION_H_
