// portolan-server: takes the agents' submaps, builds one map of them, answers queries.
#include <signal.h>

#include <cstdio>
#include <fstream>
#include <iostream>
#include <string>

#include "common/base/concat.h"
#include "common/base/logging.h"
#include "common/config/option_table.h"
#include "server/map_builder_engine.h"
#include "server/server.h"

namespace portolan {
namespace {

constexpr char kUsage[] =
    "usage: portolan-server --map FILE [flags]\n"
    "Builds one map of the submaps that agents send, keeps it in FILE, and answers queries.\n"
    "SIGINT and SIGTERM end it cleanly; after any other end it continues from FILE as well.\n"
    "The protocol is neither encrypted nor authenticated: it listens on this machine only\n"
    "unless --listen says otherwise.";

struct ProgramOptions {
  ServerOptions server;
  MapBuilderOptions map_builder;
  std::string port_file;
  std::string log_level = "info";
  bool lockstep = false;
  std::vector<std::string> lockstep_agents;

  void AddTo(OptionTable* table);
  Status Resolve();
};

void ProgramOptions::AddTo(OptionTable* table) {
  table->Add("map", &server.map_file, "", "The map file; created if there is none.");
  table->Add("listen", &server.listen, "", "host:port to listen on; port 0 takes a free one.");
  table->Add("port_file", &port_file, "",
             "The port is written to this file once the server listens; for scripts.");
  table->Add("rebuild", &server.rebuild, "",
             "Drops everything derived and builds the map anew from the raw submaps.");
  table->Add("lockstep", &lockstep, "",
             "Repeatable runs: submaps are taken in a given order (by sequence number, then by "
             "agent) whatever the timing, and background work is completed after each. Needs "
             "lockstep_agents, which must run at the same time.");
  table->Add("lockstep_agents", &lockstep_agents, "", "The agents that take part, in order.");
  table->Add("threads", &map_builder.num_threads, "",
             "Threads of the solver for more than 8,000 cameras at once.");
  table->Add("log_level", &log_level, "", "debug, info, warning, error or none.");
  table->Add("max_agents", &server.max_agents, "", "Agents connected at the same time.");
  table->Add("max_queue", &server.map_thread.max_queue, "submaps",
             "Committed submaps that wait for integration; then commits wait, and the agents keep "
             "their submaps.");
  table->Add("save_interval", &server.map_thread.save_interval, "s",
             "While submaps keep coming the map is saved this often.");
  table->Add("downlink_bytes_per_second", &server.corrections.bytes_per_second, "bytes/s",
             "Long-term limit of the corrections to one agent.");
  table->Add("offered_bytes_per_second", &server.offers.bytes_per_second, "bytes/s",
             "Long-term limit of the landmarks of others that one agent is offered; 0 for none.");
  RedundancyOptions& redundancy = map_builder.redundancy;
  table->Add("redundancy.whole_submaps", &redundancy.whole_submaps, "submaps",
             "The first so many submaps of a map keep all of theirs.");
  table->Add("redundancy.keyframe_information", &redundancy.min_keyframe_information, "",
             "Keyframes go from the joint map while every pose of their submap keeps this share of "
             "its information; 1 keeps all. Their poses follow their neighbours'.");
  table->Add("redundancy.landmark_information", &redundancy.min_landmark_information, "",
             "The same of landmarks without descriptors, of what is left then.");
  table->Add("correction_share", &server.corrections.translation_share, "",
             "A submap is told again once a keyframe moved by more than this share of the "
             "distance of its landmarks.");
}

Status ProgramOptions::Resolve() {
  PORTOLAN_ASSIGN_OR_RETURN(const LogLevel level, ParseLogLevel(log_level));
  SetLogLevel(level);
  if (server.map_file.empty()) return absl::InvalidArgumentError("--map is missing");
  if (lockstep == lockstep_agents.empty()) {
    return absl::InvalidArgumentError("--lockstep and --lockstep-agents need each other");
  }
  for (const std::string& agent : lockstep_agents) {
    server.ingest.lockstep_agents.emplace_back(agent);
  }
  PORTOLAN_RETURN_IF_ERROR(map_builder.Validate());
  return server.Validate();
}

// The file appears whole or not at all.
Status WritePortFile(const std::string& path, int port) {
  const std::string temporary = path + ".tmp";
  {
    std::ofstream file(temporary);
    file << port << "\n";
    file.close();
    if (!file) return absl::UnavailableError(Concat("cannot write ", temporary));
  }
  if (std::rename(temporary.c_str(), path.c_str()) != 0) {
    return absl::UnavailableError(Concat("cannot rename ", temporary, " to ", path));
  }
  return absl::OkStatus();
}

Status Run(const ProgramOptions& options, const sigset_t& end_signals) {
  PORTOLAN_ASSIGN_OR_RETURN(std::unique_ptr<MapEngine> engine,
                            MakeMapBuilderEngine(options.map_builder));
  PORTOLAN_ASSIGN_OR_RETURN(std::unique_ptr<Server> server,
                            Server::Start(options.server, std::move(engine)));
  std::cout << "listening on " << server->address() << std::endl;
  if (!options.port_file.empty()) {
    PORTOLAN_RETURN_IF_ERROR(WritePortFile(options.port_file, server->port()));
  }
  int signal = 0;
  sigwait(&end_signals, &signal);
  LogInfo("signal ", signal, ": saving the map");
  server->Shutdown();
  return absl::OkStatus();
}

int Main(int argc, char** argv) {
  // Before any thread starts, so that all inherit the mask and sigwait alone takes the signals.
  sigset_t end_signals;
  sigemptyset(&end_signals);
  sigaddset(&end_signals, SIGINT);
  sigaddset(&end_signals, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &end_signals, nullptr);
  signal(SIGPIPE, SIG_IGN);
  ProgramOptions options;
  OptionTable table;
  options.AddTo(&table);
  const StatusOr<CommandLine> line = table.ParseCommandLine(argc, argv);
  if (line.ok() && line->help) {
    std::cout << table.Help(kUsage);
    return 0;
  }
  Status status = line.status();
  if (status.ok() && !line->positional.empty()) {
    status = absl::InvalidArgumentError(Concat("unexpected argument '", line->positional[0], "'"));
  }
  if (status.ok()) status = options.Resolve();
  if (status.ok()) status = Run(options, end_signals);
  if (status.ok()) return 0;
  std::cerr << "portolan-server: " << status.message() << "\n";
  return absl::IsInvalidArgument(status) ? 2 : 1;
}

}  // namespace
}  // namespace portolan

int main(int argc, char** argv) { return portolan::Main(argc, argv); }
