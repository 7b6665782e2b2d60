// `portolan evaluate`: trajectories against ground truth.
#ifndef PORTOLAN_SERVER_EVALUATION_EVALUATE_COMMAND_H_
#define PORTOLAN_SERVER_EVALUATION_EVALUATE_COMMAND_H_

#include <ostream>
#include <span>
#include <string>

namespace portolan {

// `args` are the words after "evaluate". Exit codes: 0 done, 1 a file or the data is bad, 2 the
// command line is.
int RunEvaluate(std::span<const std::string> args);
int RunEvaluate(std::span<const std::string> args, std::ostream& output, std::ostream& errors);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_EVALUATION_EVALUATE_COMMAND_H_
