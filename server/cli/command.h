// The commands of the `portolan` program: each reads its own flags and returns an exit code.
#ifndef PORTOLAN_SERVER_CLI_COMMAND_H_
#define PORTOLAN_SERVER_CLI_COMMAND_H_

#include <google/protobuf/message.h>

#include <functional>
#include <ostream>
#include <span>
#include <string>
#include <string_view>

#include "common/base/status.h"
#include "common/client/map_client.h"
#include "common/config/option_table.h"

namespace portolan {

// 0; 1 if the work failed; 2 if the command line is wrong.
inline constexpr int kExitOk = 0;
inline constexpr int kExitFailed = 1;
inline constexpr int kExitUsage = 2;

// Options that all commands that talk to a server share.
struct ClientOptions {
  std::string server = "127.0.0.1:50800";
  double timeout_s = 30;
  bool json = false;

  void AddTo(OptionTable* table);
};

// Parses `args` (without program and command name). False: help was asked for or the line is wrong;
// the text is printed and *exit_code set. Positional words are allowed up to max_positional.
bool ParseArguments(std::span<const std::string> args, std::string_view usage,
                    size_t max_positional, OptionTable* table, CommandLine* line, int* exit_code);

// Prints the error on standard error; returns kExitFailed.
int Fail(const Status& status);

// The message in protobuf's JSON form with the field names of the .proto files, one line.
StatusOr<std::string> ToJson(const google::protobuf::Message& message);

// Runs `write` on the file, which appears whole or not at all, or on standard output for "" or "-".
Status WriteOutput(const std::string& path, const std::function<void(std::ostream&)>& write);

int RunInfo(std::span<const std::string> args);
int RunAgents(std::span<const std::string> args);
int RunSubmaps(std::span<const std::string> args);
int RunLandmarks(std::span<const std::string> args);
int RunTrajectory(std::span<const std::string> args);
int RunFollow(std::span<const std::string> args);
int RunExport(std::span<const std::string> args);
int RunControlPoints(std::span<const std::string> args);
int RunGeoreference(std::span<const std::string> args);
int RunSettle(std::span<const std::string> args);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_CLI_COMMAND_H_
