#include <map>
#include <set>
#include <vector>

#include "common/wire/geometry_wire.h"
#include "server/query/trajectory_query.h"
#include "server/rpc/map_handlers.h"

namespace portolan {
namespace {

constexpr int kMaxAgents = 4096;
constexpr int kMaxSessionsOfAgent = 4096;
constexpr size_t kMaxComponentsOfSession = 1024;

using States = std::vector<const SubmapState*>;

// Places the live pose by its own submap, or by the predecessor's if it is not uploaded yet.
void FillLivePose(const LivePose& live, const States& states, v1::SessionInfo* message) {
  for (const SubmapState* state : states) {
    const uint32_t number = state->refined->raw->key.sequence_number;
    Rigid3 world_from_camera;
    if (number == live.sequence_number) {
      world_from_camera = state->world_from_submap * live.submap_from_camera;
    } else if (number + 1 == live.sequence_number && live.predecessor_from_submap) {
      world_from_camera = PlaceInSuccessor(*state, live.submap_from_camera);
    } else {
      continue;
    }
    ToProto(world_from_camera, message->mutable_world_from_camera());
    message->set_live_time_ns(live.time.count());
    message->set_live_component_id(state->component.value());
  }
}

void FillSession(const SessionStatus& session, const States& states, v1::SessionInfo* message) {
  message->set_session_id(session.name.session.value());
  message->set_submap_count(session.submap_count);
  message->set_connected(session.connected);
  if (session.camera) ToProto(session.camera->intrinsics(), message->mutable_camera());
  std::set<ComponentId> components;
  States fused;
  for (const SubmapState* state : states) {
    if (IsQuarantined(*state)) continue;
    fused.push_back(state);
    components.insert(state->component);
  }
  for (const ComponentId component : components) {
    if (message->component_ids_size() == static_cast<int>(kMaxComponentsOfSession)) break;
    message->add_component_ids(component.value());
  }
  if (!states.empty()) {
    message->set_first_time_ns(states.front()->refined->raw->keyframes.front().time.count());
    message->set_last_time_ns(states.back()->refined->raw->keyframes.back().time.count());
  }
  if (session.live_pose) FillLivePose(*session.live_pose, fused, message);
}

}  // namespace

v1::ListAgentsResponse ListAgents(const ServerContext& server) {
  const std::shared_ptr<const MapSnapshot> snapshot = server.hub->Get();
  std::map<SessionName, States> states;
  for (const auto& state : snapshot->submaps) {
    const SubmapKey& key = state->refined->raw->key;
    states[{key.agent, key.session}].push_back(state.get());
  }
  v1::ListAgentsResponse response;
  response.set_map_version(snapshot->version);
  v1::AgentInfo* agent = nullptr;
  for (const SessionStatus& session : server.sessions->List()) {
    if (!agent || agent->agent_id() != session.name.agent.value()) {
      if (response.agents_size() == kMaxAgents) break;
      agent = response.add_agents();
      agent->set_agent_id(session.name.agent.value());
    }
    if (agent->sessions_size() == kMaxSessionsOfAgent) {
      agent->mutable_sessions()->erase(agent->sessions().begin());
    }
    FillSession(session, states[session.name], agent->add_sessions());
  }
  return response;
}

}  // namespace portolan
