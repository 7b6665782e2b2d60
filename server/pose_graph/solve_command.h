// `portolan solve FILE.g2o`: the server's pose graph solver on a file.
#ifndef PORTOLAN_SERVER_POSE_GRAPH_SOLVE_COMMAND_H_
#define PORTOLAN_SERVER_POSE_GRAPH_SOLVE_COMMAND_H_

#include <span>
#include <string>

namespace portolan {

// args: without the program and the command name. Prints to stdout, errors to stderr; returns the
// exit code.
int RunSolve(std::span<const std::string> args);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_POSE_GRAPH_SOLVE_COMMAND_H_
