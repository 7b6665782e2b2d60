// portolan: reads a server's map and works on files.
#include <iostream>
#include <span>
#include <string>
#include <vector>

#include "server/cli/command.h"
#include "server/evaluation/evaluate_command.h"
#include "server/pose_graph/solve_command.h"

namespace {

struct Command {
  const char* name;
  const char* summary;
  int (*run)(std::span<const std::string> args);
};

constexpr Command kCommands[] = {
    {"info", "counts, components and sizes of the map", portolan::RunInfo},
    {"agents", "the agents with their sessions", portolan::RunAgents},
    {"submaps", "the submaps", portolan::RunSubmaps},
    {"landmarks", "landmarks in a box, in a sphere, or nearest to a point", portolan::RunLandmarks},
    {"trajectory", "an agent's trajectory", portolan::RunTrajectory},
    {"follow", "changes as they happen", portolan::RunFollow},
    {"export", "the map as PLY, PNG, TUM or g2o", portolan::RunExport},
    {"control-points", "surveyed points: list, add, import, remove; the site's origin",
     portolan::RunControlPoints},
    {"georeference", "how components fit control points and satellite fixes",
     portolan::RunGeoreference},
    {"settle", "waits until the map has settled", portolan::RunSettle},
    {"evaluate", "compares trajectories with ground truth",
     [](std::span<const std::string> args) { return portolan::RunEvaluate(args); }},
    {"solve", "solves a pose graph file", portolan::RunSolve},
};

void PrintUsage(std::ostream& out) {
  out << "usage: portolan COMMAND [flags]\n\ncommands (portolan COMMAND --help tells more):\n";
  for (const Command& command : kCommands) {
    out << "  " << command.name << std::string(16 - std::string(command.name).size(), ' ')
        << command.summary << "\n";
  }
}

}  // namespace

int main(int argc, char** argv) {
  const std::vector<std::string> words(argv + 1, argv + argc);
  if (words.empty() || words[0] == "--help" || words[0] == "-h" || words[0] == "help") {
    PrintUsage(words.empty() ? std::cerr : std::cout);
    return words.empty() ? portolan::kExitUsage : portolan::kExitOk;
  }
  for (const Command& command : kCommands) {
    if (words[0] == command.name) return command.run(std::span(words).subspan(1));
  }
  std::cerr << "portolan: unknown command '" << words[0] << "'\n\n";
  PrintUsage(std::cerr);
  return portolan::kExitUsage;
}
