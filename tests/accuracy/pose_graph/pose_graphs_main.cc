// Does the pose graph solver find the global minimum from poor starts, and how fast?
//
//   portolan-pose-graphs [FOLDER]
//
// Each generated graph is solved from dead reckoning, as a file's own poor start, and from the
// truth without the chordal start, which leads to the minimum that a correct solver should find.
// With FOLDER the graphs are written there as g2o files.
#include <cstdio>
#include <string>

#include "server/pose_graph/g2o_file.h"
#include "server/pose_graph/pose_graph_solver.h"
#include "tests/accuracy/pose_graph/graph_worlds.h"

namespace portolan {
namespace {

struct Case {
  const char* name;
  bool lattice;
  GraphWorldOptions options;
};

constexpr Case kCases[] = {
    {"torus, noise 0.05", false, {5000, 9048, 0.05, 0.05, 1}},
    {"torus, noise 0.1", false, {5000, 9048, 0.1, 0.1, 2}},
    {"torus, noise 0.2", false, {5000, 9048, 0.2, 0.2, 3}},
    {"lattice, noise 0.05", true, {5750, 16869, 0.05, 0.05, 4}},
    {"lattice, noise 0.1", true, {5750, 16869, 0.1, 0.1, 5}},
    {"lattice, noise 0.2", true, {5750, 16869, 0.2, 0.2, 6}},
};

Status RunCase(const Case& setup, const std::string& folder) {
  GraphWorld world =
      setup.lattice ? MakeLatticeWorld(setup.options) : MakeTorusWorld(setup.options);
  const size_t edges = world.graph.edges.size();
  if (!folder.empty()) {
    const std::string file = std::string(setup.lattice ? "/lattice" : "/torus") +
                             std::to_string(setup.options.seed) + ".g2o";
    PORTOLAN_RETURN_IF_ERROR(WriteG2o(folder + file, world.graph));
  }
  PoseGraph3 reference = world.graph;
  reference.world_from_node = world.truth;
  PoseGraphSolverOptions options;
  PORTOLAN_ASSIGN_OR_RETURN(const PoseGraphSummary solved, SolvePoseGraph(options, world.graph));
  options.chordal_start = false;
  PORTOLAN_ASSIGN_OR_RETURN(const PoseGraphSummary best, SolvePoseGraph(options, reference));
  const bool found = solved.final_chi2 < best.final_chi2 * (1 + 1e-5);
  std::printf("%-20s %6zu %6zu %13.6g %13.6g %13.7g %13.7g %5d %7.2f  %s\n", setup.name,
              world.truth.size(), edges, solved.initial_chi2, solved.start_chi2, solved.final_chi2,
              best.final_chi2, solved.iterations, solved.seconds,
              found ? "minimum" : "NOT THE MINIMUM");
  return absl::OkStatus();
}

int Main(const std::string& folder) {
  std::printf("%-20s %6s %6s %13s %13s %13s %13s %5s %7s\n", "graph", "poses", "edges",
              "dead reckoning", "start", "final chi2", "from truth", "steps", "seconds");
  for (const Case& setup : kCases) {
    const Status status = RunCase(setup, folder);
    if (status.ok()) continue;
    std::fprintf(stderr, "portolan-pose-graphs: %s\n", std::string(status.message()).c_str());
    return 1;
  }
  return 0;
}

}  // namespace
}  // namespace portolan

int main(int argc, char** argv) { return portolan::Main(argc > 1 ? argv[1] : ""); }
