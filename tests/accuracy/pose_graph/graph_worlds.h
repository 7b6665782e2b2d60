// Pose graphs like the public ones, with known truth and a start by dead reckoning.
#ifndef PORTOLAN_TESTS_ACCURACY_POSE_GRAPH_GRAPH_WORLDS_H_
#define PORTOLAN_TESTS_ACCURACY_POSE_GRAPH_GRAPH_WORLDS_H_

#include <vector>

#include "server/pose_graph/pose_graph.h"

namespace portolan {

struct GraphWorld {
  PoseGraph3 graph;  // started by dead reckoning along node order
  std::vector<Rigid3> truth;
};

struct GraphWorldOptions {
  int poses = 5000;
  int edges = 9048;
  // Standard deviations of every edge, of the step of 1 and in radians.
  double sigma_translation = 0.1;
  double sigma_rotation_rad = 0.1;
  unsigned seed = 1;
};

// A walk round the tube of a torus, 50 poses a turn, closed to the turn before (as torus3D).
GraphWorld MakeTorusWorld(const GraphWorldOptions& options);

// A walk along the lattice lines of a cube with random turns, closed where it comes by again (as
// cubicle).
GraphWorld MakeLatticeWorld(const GraphWorldOptions& options);

}  // namespace portolan

#endif  // PORTOLAN_TESTS_ACCURACY_POSE_GRAPH_GRAPH_WORLDS_H_
