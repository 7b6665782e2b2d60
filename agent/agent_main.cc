// portolan-agent: turns the images of one vehicle into submaps and streams them to the server.
#include <atomic>
#include <csignal>
#include <cstdio>
#include <opencv2/core/utility.hpp>

#include "agent/agent_flags.h"
#include "agent/agent_runner.h"
#include "common/base/logging.h"
#include "common/config/option_table.h"

namespace portolan {
namespace {

constexpr char kUsage[] =
    "usage: portolan-agent [flags] SEQUENCE\n"
    "\n"
    "SEQUENCE is a EuRoC/ASL, TUM RGB-D, KITTI odometry or plain image folder, a video file or a\n"
    "camera device. Every option can stand in a YAML file, too: --config FILE; --print-config\n"
    "prints one with all options.\n";

std::atomic<bool> stop_requested = false;

void RequestStop(int) { stop_requested = true; }

struct AllOptions {
  RunnerOptions runner;
  AgentOptions agent;
  UplinkOptions uplink;
  OutboxOptions outbox;
  ImageSourceOptions source;
  std::string log_level = "info";
  bool print_config = false;
};

void AddRunnerOptions(RunnerOptions* options, OptionTable* table) {
  table->Add("agent", &options->agent, "", "name of the vehicle, unique in the fleet");
  table->Add("server", &options->server, "", "host:port of the server, or none");
  table->Add("outbox", &options->outbox, "", "folder of submaps that the server does not have yet");
  table->Add("output", &options->output, "",
             "folder for live.tum, odometry.tum, corrected.tum, summary.json; empty: not written");
  table->Add("finish_timeout_s", &options->finish_timeout_s, "s",
             "longest wait at the end for the server to take everything and to settle");
  table->Add("unreachable_timeout_s", &options->unreachable_timeout_s, "s",
             "wait at the end if no server was ever reached");
  table->Add("session", &options->session, "",
             "id of this run; 0 draws one, a fixed one makes the uploaded bytes repeatable");
  table->Add("uplink_bytes_per_second", &options->budget.bytes_per_second, "bytes/s",
             "submaps' bytes per second of the sensors' time; points that do not fit are not "
             "described; 0 for no limit");
  table->Add("uplink_burst_bytes", &options->budget.burst_bytes, "bytes",
             "what submaps may take beyond that after a quiet time");
  table->Add("progress", &options->progress, "", "a line of progress on a terminal");
}

Status Run(int argc, char** argv) {
  AllOptions options;
  OptionTable table;
  AddRunnerOptions(&options.runner, &table);
  AddImageSourceOptions(&table, &options.source);
  AddAgentOptions(&options.agent, &table);
  table.Add("outbox_max_bytes", &options.outbox.max_bytes, "bytes",
            "limit of what waits in the outbox; a new submap that would exceed it is refused");
  table.Add("log_level", &options.log_level, "", "debug, info, warning, error or none");
  table.Add("print_config", &options.print_config, "", "print all options as YAML and end");
  PORTOLAN_ASSIGN_OR_RETURN(const CommandLine line, table.ParseCommandLine(argc, argv));
  if (line.help) {
    std::fputs(table.Help(kUsage).c_str(), stdout);
    return absl::OkStatus();
  }
  if (options.print_config) {
    options.print_config = false;
    std::fputs(table.ToYaml().c_str(), stdout);
    return absl::OkStatus();
  }
  if (line.positional.size() > 1) return absl::InvalidArgumentError("more than one sequence given");
  if (line.positional.size() == 1) options.source.path = line.positional[0];
  if (options.source.path.empty()) {
    return absl::InvalidArgumentError("no sequence given; see --help");
  }
  PORTOLAN_ASSIGN_OR_RETURN(const LogLevel level, ParseLogLevel(options.log_level));
  SetLogLevel(level);
  PORTOLAN_ASSIGN_OR_RETURN(auto source, OpenImageSource(options.source));
  LogInfo(source->info().description);
  PORTOLAN_ASSIGN_OR_RETURN(auto runner,
                            AgentRunner::Create(options.runner, options.agent, options.uplink,
                                                options.outbox, std::move(source)));
  const Status status = runner->Run(stop_requested);
  std::printf("%s\n", ToText(runner->summary()).c_str());
  return status;
}

}  // namespace
}  // namespace portolan

int main(int argc, char** argv) {
  std::signal(SIGINT, portolan::RequestStop);
  std::signal(SIGTERM, portolan::RequestStop);
  cv::setNumThreads(1);  // one core a vehicle, and repeatable sums
  const portolan::Status status = portolan::Run(argc, argv);
  if (!status.ok()) {
    std::fprintf(stderr, "error: %s\n", std::string(status.message()).c_str());
    return absl::IsInvalidArgument(status) ? 2 : 1;
  }
  return 0;
}
