// Maximum likelihood solution of a pose graph.
#ifndef PORTOLAN_SERVER_POSE_GRAPH_POSE_GRAPH_SOLVER_H_
#define PORTOLAN_SERVER_POSE_GRAPH_POSE_GRAPH_SOLVER_H_

#include "common/base/status.h"
#include "server/pose_graph/pose_graph.h"

namespace portolan {

struct PoseGraphSolverOptions {
  // Levenberg-Marquardt iterations at most, for each start.
  int max_iterations = 200;
  // Also start from the chordal solution and keep the better end: the poses in the file may lead
  // into a local minimum.
  bool chordal_start = true;

  Status Validate() const;
};

struct PoseGraphSummary {
  double initial_chi2 = 0;  // of the poses as given
  double start_chi2 = 0;    // of the start that won
  double final_chi2 = 0;
  bool chordal_start_won = false;
  int iterations = 0;
  int connected_parts = 0;
  double seconds = 0;
};

// Replaces the poses by the solution. Held are the fixed nodes and, in each connected part without
// one, the node that comes first. InvalidArgument if an edge names no node or an information
// matrix is not positive semi-definite.
StatusOr<PoseGraphSummary> SolvePoseGraph(const PoseGraphSolverOptions& options, PoseGraph3& graph);
StatusOr<PoseGraphSummary> SolvePoseGraph(const PoseGraphSolverOptions& options, PoseGraph2& graph);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_POSE_GRAPH_POSE_GRAPH_SOLVER_H_
