// info, agents, submaps, follow, settle: what the map holds, as text or JSON.
#include <cinttypes>
#include <iostream>

#include "common/base/concat.h"
#include "server/cli/command.h"

namespace portolan {
namespace {

// A 64-bit session id as it is written everywhere: 16 hexadecimal digits.
std::string SessionText(uint64_t session) {
  char text[17];
  std::snprintf(text, sizeof(text), "%016" PRIx64, session);
  return text;
}

std::string Number(double value, int digits = 3) {
  char text[64];
  std::snprintf(text, sizeof(text), "%.*f", digits, value);
  return text;
}

int PrintJson(const google::protobuf::Message& message) {
  const StatusOr<std::string> json = ToJson(message);
  if (!json.ok()) return Fail(json.status());
  std::cout << *json << "\n";
  return kExitOk;
}

void PrintInfo(const v1::MapInfo& info) {
  std::cout << "map version     " << info.map_version() << "\n"
            << "components      " << info.components_size() << "\n"
            << "agents          " << info.agent_count() << " (" << info.connected_agent_count()
            << " connected)\n"
            << "submaps         " << info.submap_count() << " (" << info.quarantined_submap_count()
            << " quarantined)\n"
            << "keyframes       " << info.keyframe_count() << "\n"
            << "landmarks       " << info.landmark_count() << "\n"
            << "closures        " << info.closure_count() << "\n"
            << "database        " << Number(static_cast<double>(info.database_bytes()) / 1e6)
            << " MB\n"
            << "server version  " << info.software_version() << "\n";
  for (const v1::ComponentInfo& component : info.components()) {
    std::cout << "component " << component.component_id() << ": " << component.submap_count()
              << " submaps, " << component.landmark_count() << " landmarks, "
              << (component.metric() ? "metric" : "scale free")
              << (component.gravity_aligned() ? ", gravity aligned" : "")
              << (component.has_site_origin() ? ", georeferenced" : "") << ", agents";
    for (const std::string& agent : component.agent_ids()) std::cout << " " << agent;
    std::cout << "\n";
  }
}

void PrintAgents(const v1::ListAgentsResponse& response) {
  for (const v1::AgentInfo& agent : response.agents()) {
    for (const v1::SessionInfo& session : agent.sessions()) {
      std::cout << agent.agent_id() << " session " << SessionText(session.session_id()) << ": "
                << session.submap_count() << " submaps, "
                << Number(static_cast<double>(session.first_time_ns()) * 1e-9) << " to "
                << Number(static_cast<double>(session.last_time_ns()) * 1e-9) << " s, components";
      for (const int64_t id : session.component_ids()) std::cout << " " << id;
      if (session.connected()) std::cout << ", connected";
      if (session.has_world_from_camera()) {
        const v1::Vector3& position = session.world_from_camera().translation();
        std::cout << ", now at " << Number(position.x()) << " " << Number(position.y()) << " "
                  << Number(position.z()) << " in component " << session.live_component_id();
      }
      std::cout << "\n";
    }
  }
}

void PrintSubmap(const v1::SubmapInfo& submap) {
  const v1::Vector3& position = submap.world_from_submap().translation();
  std::cout << submap.submap_id() << " " << submap.agent_id() << " #" << submap.sequence_number()
            << " component " << submap.component_id() << ": " << submap.keyframe_count()
            << " keyframes, " << submap.landmark_count() << " landmarks, "
            << Number(submap.rms_reprojection_px(), 2) << " px, "
            << Number(submap.encoded_bytes() * 1e-3, 1) << " kB, at " << Number(position.x()) << " "
            << Number(position.y()) << " " << Number(position.z()) << " scale "
            << Number(submap.world_from_submap().scale());
  if (!submap.quarantine_reason().empty()) {
    std::cout << ", quarantined: " << submap.quarantine_reason();
  }
  std::cout << "\n";
}

}  // namespace

int RunInfo(std::span<const std::string> args) {
  ClientOptions client;
  OptionTable table;
  client.AddTo(&table);
  CommandLine line;
  int exit_code;
  if (!ParseArguments(args,
                      "usage: portolan info [flags]\nCounts, components and sizes of the map.", 0,
                      &table, &line, &exit_code)) {
    return exit_code;
  }
  const auto info = MapClient(client.server, FromSeconds(client.timeout_s)).GetMapInfo();
  if (!info.ok()) return Fail(info.status());
  if (client.json) return PrintJson(*info);
  PrintInfo(*info);
  return kExitOk;
}

int RunAgents(std::span<const std::string> args) {
  ClientOptions client;
  OptionTable table;
  client.AddTo(&table);
  CommandLine line;
  int exit_code;
  if (!ParseArguments(args,
                      "usage: portolan agents [flags]\nThe agents that ever contributed, with "
                      "their sessions.",
                      0, &table, &line, &exit_code)) {
    return exit_code;
  }
  const auto agents = MapClient(client.server, FromSeconds(client.timeout_s)).ListAgents();
  if (!agents.ok()) return Fail(agents.status());
  if (client.json) return PrintJson(*agents);
  PrintAgents(*agents);
  return kExitOk;
}

int RunSubmaps(std::span<const std::string> args) {
  ClientOptions client;
  v1::ListSubmapsRequest request;
  std::string agent;
  int64_t component = 0;
  OptionTable table;
  client.AddTo(&table);
  table.Add("agent", &agent, "", "Only this agent's.");
  table.Add("component", &component, "", "Only those in this component; 0: in any.");
  CommandLine line;
  int exit_code;
  if (!ParseArguments(args, "usage: portolan submaps [flags]\nThe submaps, one a line.", 0, &table,
                      &line, &exit_code)) {
    return exit_code;
  }
  request.set_agent_id(agent);
  request.set_component_id(component);
  const auto submaps = MapClient(client.server, FromSeconds(client.timeout_s)).ListSubmaps(request);
  if (!submaps.ok()) return Fail(submaps.status());
  if (client.json) return PrintJson(*submaps);
  for (const v1::SubmapInfo& submap : submaps->submaps()) PrintSubmap(submap);
  return kExitOk;
}

int RunFollow(std::span<const std::string> args) {
  ClientOptions client;
  uint64_t since = 0;
  int64_t count = 0;
  OptionTable table;
  client.AddTo(&table);
  table.Add("since", &since, "", "Tells what changed after this map version; 0: everything.");
  table.Add("count", &count, "", "Ends after so many versions; 0: never.");
  CommandLine line;
  int exit_code;
  if (!ParseArguments(args,
                      "usage: portolan follow [flags]\nNew and moved submaps as the map changes, "
                      "until interrupted. With --json one line a message.",
                      0, &table, &line, &exit_code)) {
    return exit_code;
  }
  int64_t versions = 0;
  const Status status =
      MapClient(client.server).FollowChanges(since, [&](const v1::MapChange& change) {
        if (client.json) {
          PrintJson(change);
        } else {
          std::cout << "version " << change.map_version() << ": " << change.submaps_size()
                    << " submaps\n";
          for (const v1::SubmapInfo& submap : change.submaps()) PrintSubmap(submap);
        }
        std::cout.flush();
        versions += !change.more();
        return count == 0 || versions < count;
      });
  return status.ok() ? kExitOk : Fail(status);
}

int RunSettle(std::span<const std::string> args) {
  ClientOptions client;
  client.timeout_s = 600;
  OptionTable table;
  client.AddTo(&table);
  CommandLine line;
  int exit_code;
  if (!ParseArguments(args,
                      "usage: portolan settle [flags]\nWaits until everything committed is in the "
                      "map and no background work is left; prints the map version.",
                      0, &table, &line, &exit_code)) {
    return exit_code;
  }
  const auto version = MapClient(client.server).Settle(FromSeconds(client.timeout_s));
  if (!version.ok()) return Fail(version.status());
  if (client.json) {
    std::cout << "{\"map_version\":\"" << *version << "\"}\n";
  } else {
    std::cout << *version << "\n";
  }
  return kExitOk;
}

}  // namespace portolan
