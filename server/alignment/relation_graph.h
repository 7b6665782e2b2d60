// A graph of similarities between submaps, solved robustly: links are believed, closures must
// prove themselves by graduated non-convexity (Yang, Antonante, Tzoumas, Carlone, "Graduated
// non-convexity for robust spatial perception", RA-L 2020, truncated least squares).
#ifndef PORTOLAN_SERVER_ALIGNMENT_RELATION_GRAPH_H_
#define PORTOLAN_SERVER_ALIGNMENT_RELATION_GRAPH_H_

#include <vector>

#include "common/base/status.h"
#include "common/geometry/similarity3.h"

namespace portolan {

struct Relation {
  int a = 0;
  int b = 0;
  Similarity3 a_from_b;
  // Of the right perturbation [translation; rotation; log scale] of a_from_b.
  Matrix7d information = Matrix7d::Identity();
  // True: may be wrong.
  bool doubtful = false;
};

struct RelationGraph {
  std::vector<Similarity3> world_from_node;
  // Nodes held where they are, one a connected part at least.
  std::vector<bool> fixed;
  std::vector<Relation> relations;
};

struct RelationGraphOptions {
  int max_iterations = 30;     // Levenberg-Marquardt, each solve
  double min_decrease = 1e-9;  // relative decrease of the cost under which it has converged
  int max_graduations = 40;    // GNC steps
  double graduation = 1.4;     // factor of the control parameter, as in the paper
  // Squared error of a true closure: 99.9 % of chi-square with 7 degrees of freedom is 24.3.
  double max_chi2 = 24.3;

  Status Validate() const;
};

// Log(a_from_b^-1 * world_from_a^-1 * world_from_b), and its derivatives with respect to right
// perturbations of the two poses (Sim(3), [translation; rotation; log scale]).
Vector7d RelationError(const Similarity3& a_from_b, const Similarity3& world_from_a,
                       const Similarity3& world_from_b, Matrix7d* d_error_d_a = nullptr,
                       Matrix7d* d_error_d_b = nullptr);

// Replaces the nodes by the solution. Returns the weights of the relations: 1 for those not
// doubtful, in [0, 1] for the others, mostly 0 or 1. Deterministic.
std::vector<double> SolveRelationGraph(const RelationGraphOptions& options, RelationGraph* graph);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_ALIGNMENT_RELATION_GRAPH_H_
