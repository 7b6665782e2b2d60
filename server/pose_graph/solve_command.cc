#include "server/pose_graph/solve_command.h"

#include <cstdio>
#include <cstdlib>
#include <variant>

#include "server/pose_graph/g2o_file.h"
#include "server/pose_graph/pose_graph_solver.h"

namespace portolan {
namespace {

constexpr char kHelp[] =
    "usage: portolan solve FILE.g2o [--output OUT.g2o] [--tum OUT.tum] [--no-chordal]\n"
    "                      [--max-iterations N]\n"
    "\n"
    "Solves a pose graph (VERTEX_SE3:QUAT and EDGE_SE3:QUAT, or VERTEX_SE2 and EDGE_SE2; FIX)\n"
    "with the server's solver and prints chi2 = sum of e' * information * e, without the factor\n"
    "1/2, e = translation and quaternion vector part (2-D: heading) of the error, as in g2o.\n"
    "\n"
    "  --output FILE        write the solved graph\n"
    "  --tum FILE           write the solved poses as a TUM trajectory, node id as the time\n"
    "  --no-chordal         start only from the poses of the file\n"
    "  --max-iterations N   Levenberg-Marquardt iterations at most (200)\n";

struct Arguments {
  std::string input, output, tum;
  PoseGraphSolverOptions solver;
};

StatusOr<Arguments> Parse(std::span<const std::string> args) {
  Arguments parsed;
  for (size_t i = 0; i < args.size(); ++i) {
    const std::string& arg = args[i];
    if (arg == "--no-chordal") {
      parsed.solver.chordal_start = false;
      continue;
    }
    if (!arg.starts_with("--")) {
      if (!parsed.input.empty()) return absl::InvalidArgumentError("more than one input file");
      parsed.input = arg;
      continue;
    }
    if (i + 1 == args.size()) return absl::InvalidArgumentError(arg + " needs a value");
    const std::string& value = args[++i];
    if (arg == "--output") {
      parsed.output = value;
    } else if (arg == "--tum") {
      parsed.tum = value;
    } else if (arg == "--max-iterations") {
      parsed.solver.max_iterations = std::atoi(value.c_str());
    } else {
      return absl::InvalidArgumentError("unknown option " + arg);
    }
  }
  if (parsed.input.empty()) return absl::InvalidArgumentError("no input file");
  return parsed;
}

template <typename Graph>
Status SolveAndWrite(const Arguments& arguments, Graph graph) {
  PORTOLAN_ASSIGN_OR_RETURN(const PoseGraphSummary summary,
                            SolvePoseGraph(arguments.solver, graph));
  std::printf("%s: %zu poses, %zu edges, %d connected part(s)\n", arguments.input.c_str(),
              graph.world_from_node.size(), graph.edges.size(), summary.connected_parts);
  std::printf("initial chi2  %.10g\n", summary.initial_chi2);
  std::printf("start chi2    %.10g (%s)\n", summary.start_chi2,
              summary.chordal_start_won ? "chordal" : "poses of the file");
  std::printf("final chi2    %.10g after %d iterations, %.2f s\n", summary.final_chi2,
              summary.iterations, summary.seconds);
  if (!arguments.output.empty()) PORTOLAN_RETURN_IF_ERROR(WriteG2o(arguments.output, graph));
  if (!arguments.tum.empty()) PORTOLAN_RETURN_IF_ERROR(WriteTumOfGraph(arguments.tum, graph));
  return absl::OkStatus();
}

Status Run(const Arguments& arguments) {
  PORTOLAN_ASSIGN_OR_RETURN(auto graph, ReadG2o(arguments.input));
  return std::visit([&](auto& g) { return SolveAndWrite(arguments, std::move(g)); }, graph);
}

}  // namespace

int RunSolve(std::span<const std::string> args) {
  if (!args.empty() && (args[0] == "--help" || args[0] == "-h")) {
    std::fputs(kHelp, stdout);
    return 0;
  }
  const auto arguments = Parse(args);
  if (!arguments.ok()) {
    std::fprintf(stderr, "error: %s\n\n%s", std::string(arguments.status().message()).c_str(),
                 kHelp);
    return 2;
  }
  const Status status = Run(*arguments);
  if (!status.ok()) {
    std::fprintf(stderr, "error: %s\n", std::string(status.message()).c_str());
    return 1;
  }
  return 0;
}

}  // namespace portolan
