#include <algorithm>
#include <map>
#include <set>

#include "server/rpc/map_handlers.h"
#include "server/rpc/survey_messages.h"

namespace portolan {
namespace {

constexpr size_t kMaxComponents = 65536;
constexpr size_t kMaxAgentsOfComponent = 1024;

struct ComponentSummary {
  uint32_t submap_count = 0;
  uint64_t landmark_count = 0;
  std::set<AgentId> agents;
};

void AddComponents(const MapSnapshot& snapshot,
                   const std::map<ComponentId, ComponentSummary>& summaries, v1::MapInfo* info) {
  for (const ComponentState& component : snapshot.components) {
    const auto summary = summaries.find(component.id);
    if (summary == summaries.end()) continue;
    if (info->components_size() == kMaxComponents) return;
    v1::ComponentInfo* message = info->add_components();
    message->set_component_id(component.id.value());
    message->set_metric(component.metric);
    message->set_gravity_aligned(component.gravity_aligned);
    if (component.georeference && component.georeference->is_georeferenced) {
      ToProto(component.georeference->origin, message->mutable_site_origin());
    }
    message->set_submap_count(summary->second.submap_count);
    message->set_landmark_count(summary->second.landmark_count);
    for (const AgentId& agent : summary->second.agents) {
      if (message->agent_ids_size() < static_cast<int>(kMaxAgentsOfComponent)) {
        message->add_agent_ids(agent.value());
      }
    }
  }
}

void AddAgents(const SessionTable& sessions, v1::MapInfo* info) {
  std::set<AgentId> all, connected;
  for (const SessionStatus& session : sessions.List()) {
    all.insert(session.name.agent);
    if (session.connected) connected.insert(session.name.agent);
  }
  info->set_agent_count(static_cast<uint32_t>(all.size()));
  info->set_connected_agent_count(static_cast<uint32_t>(connected.size()));
}

}  // namespace

v1::MapInfo GetMapInfo(const ServerContext& server) {
  const std::shared_ptr<const MapSnapshot> snapshot = server.hub->Get();
  std::map<ComponentId, ComponentSummary> summaries;
  v1::MapInfo info;
  uint32_t quarantined_count = 0;
  uint64_t keyframe_count = 0, landmark_count = 0;
  for (const auto& state : snapshot->submaps) {
    keyframe_count += state->refined->raw->keyframes.size();
    landmark_count += state->landmarks.size();
    if (IsQuarantined(*state)) {
      ++quarantined_count;
      continue;
    }
    ComponentSummary& summary = summaries[state->component];
    ++summary.submap_count;
    summary.landmark_count += state->landmarks.size();
    summary.agents.insert(state->refined->raw->key.agent);
  }
  AddComponents(*snapshot, summaries, &info);
  AddAgents(*server.sessions, &info);
  info.set_map_version(snapshot->version);
  info.set_submap_count(static_cast<uint32_t>(snapshot->submaps.size()));
  info.set_quarantined_submap_count(quarantined_count);
  info.set_keyframe_count(keyframe_count);
  info.set_landmark_count(landmark_count);
  info.set_closure_count(snapshot->closures ? static_cast<uint32_t>(snapshot->closures->size())
                                            : 0);
  const StatusOr<int64_t> size = server.store->SizeBytes();
  if (size.ok()) info.set_database_bytes(static_cast<uint64_t>(*size));
  info.set_software_version(server.software_version);
  return info;
}

bool IsQuarantined(const SubmapState& state) { return !state.refined->quarantine_reason.empty(); }

bool IsMetric(const MapSnapshot& snapshot, ComponentId component) {
  const auto found =
      std::find_if(snapshot.components.begin(), snapshot.components.end(),
                   [&](const ComponentState& state) { return state.id == component; });
  return found != snapshot.components.end() && found->metric;
}

}  // namespace portolan
