#include <algorithm>
#include <map>
#include <utility>
#include <vector>

#include "common/wire/geometry_wire.h"
#include "server/query/trajectory_query.h"
#include "server/rpc/map_handlers.h"

namespace portolan {
namespace {

constexpr size_t kMaxPosesOfSegment = 20000;

using States = std::vector<std::shared_ptr<const SubmapState>>;

// The fused submaps of the agent that the request means, by session and sequence number.
States FindStates(const MapSnapshot& snapshot, const SessionTable& sessions,
                  const v1::GetTrajectoryRequest& request) {
  std::map<SessionId, size_t> order;  // of the sessions' creation
  for (const SessionStatus& session : sessions.List()) {
    order.emplace(session.name.session, order.size());
  }
  States states;
  for (const auto& state : snapshot.submaps) {
    const SubmapKey& key = state->refined->raw->key;
    if (IsQuarantined(*state) || key.agent.value() != request.agent_id()) continue;
    if (request.session_id() != 0 && key.session.value() != request.session_id()) continue;
    if (request.component_id() != 0 && state->component.value() != request.component_id()) continue;
    states.push_back(state);
  }
  std::stable_sort(states.begin(), states.end(), [&](const auto& a, const auto& b) {
    return order[a->refined->raw->key.session] < order[b->refined->raw->key.session];
  });
  return states;
}

void FillSegment(const MapSnapshot& snapshot, const SubmapState& state,
                 const std::vector<TimedPose>& poses, v1::TrajectorySegment* segment) {
  const RefinedSubmap& refined = *state.refined;
  segment->set_map_version(snapshot.version);
  segment->set_submap_id(refined.id.value());
  segment->set_session_id(refined.raw->key.session.value());
  segment->set_sequence_number(refined.raw->key.sequence_number);
  segment->set_component_id(state.component.value());
  segment->set_metric(IsMetric(snapshot, state.component));
  const size_t count = std::min(poses.size(), kMaxPosesOfSegment);
  for (size_t i = 0; i < count; ++i) {
    segment->add_time_ns(poses[i].time.count());
    AppendPose(poses[i].world_from_camera, segment->mutable_world_from_camera());
  }
}

}  // namespace

StatusOr<PageMaker<v1::TrajectorySegment>> GetTrajectory(const ServerContext& server,
                                                         const v1::GetTrajectoryRequest& request) {
  if (request.agent_id().empty()) return absl::InvalidArgumentError("agent_id is missing");
  if (request.kind() != v1::TRAJECTORY_KIND_KEYFRAMES &&
      request.kind() != v1::TRAJECTORY_KIND_FRAMES) {
    return absl::InvalidArgumentError("kind is missing or unknown");
  }
  const bool all_frames = request.kind() == v1::TRAJECTORY_KIND_FRAMES;
  std::shared_ptr<const MapSnapshot> snapshot = server.hub->Get();
  States states = FindStates(*snapshot, *server.sessions, request);
  return [snapshot = std::move(snapshot), states = std::move(states), all_frames, next = size_t{0},
          session = SessionId(),
          last = std::optional<Timestamp>()](v1::TrajectorySegment* segment) mutable {
    if (next == states.size()) return false;
    const SubmapState& state = *states[next++];
    if (state.refined->raw->key.session != session) last.reset();
    session = state.refined->raw->key.session;
    const std::vector<TimedPose> poses = PosesOf(state, all_frames, last);
    if (!poses.empty()) last = poses.back().time;
    FillSegment(*snapshot, state, poses, segment);
    return true;
  };
}

}  // namespace portolan
