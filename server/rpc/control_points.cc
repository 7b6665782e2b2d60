#include <set>

#include "common/base/concat.h"
#include "server/alignment/position_references.h"
#include "server/rpc/map_handlers.h"
#include "server/rpc/survey_messages.h"

namespace portolan {
namespace {

constexpr int kMaxGeoreferencedComponents = 1024;

// NotFound unless some keyframe of the agent is meant.
Status CheckObservation(const MapSnapshot& snapshot, const std::string& point,
                        const ControlObservation& observation) {
  bool is_known = false;
  Timestamp nearest{};
  Duration least = Duration::max();
  for (const auto& state : snapshot.submaps) {
    const Submap& raw = *state->refined->raw;
    if (raw.key.agent != observation.agent) continue;
    if (observation.session && raw.key.session != *observation.session) continue;
    is_known = true;
    if (KeyframeAt(raw, observation.time) >= 0) return absl::OkStatus();
    for (const Keyframe& keyframe : raw.keyframes) {
      const Duration apart = std::chrono::abs(keyframe.time - observation.time);
      if (apart >= least) continue;
      least = apart;
      nearest = keyframe.time;
    }
  }
  if (!is_known) {
    return absl::NotFoundError(Concat("control point ", point, ": the map has no submap of agent ",
                                      observation.agent.value(),
                                      observation.session ? " in that session" : ""));
  }
  return absl::NotFoundError(Concat("control point ", point, ": agent ", observation.agent.value(),
                                    " has no keyframe at ", observation.time.count(),
                                    " ns; the nearest one is at ", nearest.count(), " ns"));
}

}  // namespace

v1::ControlPoints ListControlPoints(const ServerContext& server) {
  return ToProto(*server.survey->Get());
}

StatusOr<v1::ControlPoints> AddControlPoints(const ServerContext& server,
                                             const v1::AddControlPointsRequest& request) {
  const std::shared_ptr<const MapSnapshot> snapshot = server.hub->Get();
  std::vector<ControlPoint> points;
  std::set<std::string> ids;
  for (const v1::ControlPoint& message : request.points()) {
    PORTOLAN_ASSIGN_OR_RETURN(ControlPoint point, FromProto(message));
    if (!ids.insert(point.id).second) {
      return absl::InvalidArgumentError(Concat("control point ", point.id, " is given twice"));
    }
    for (const ControlObservation& observation : point.observations) {
      PORTOLAN_RETURN_IF_ERROR(CheckObservation(*snapshot, point.id, observation));
    }
    points.push_back(std::move(point));
  }
  PORTOLAN_RETURN_IF_ERROR(server.survey->Add(std::move(points), request.replace()));
  return ListControlPoints(server);
}

StatusOr<v1::ControlPoints> RemoveControlPoints(const ServerContext& server,
                                                const v1::RemoveControlPointsRequest& request) {
  PORTOLAN_RETURN_IF_ERROR(server.survey->Remove({request.ids().begin(), request.ids().end()}));
  return ListControlPoints(server);
}

StatusOr<v1::ControlPoints> SetSiteOrigin(const ServerContext& server,
                                          const v1::SetSiteOriginRequest& request) {
  std::optional<SiteOrigin> origin;
  if (request.has_origin()) {
    PORTOLAN_ASSIGN_OR_RETURN(origin, FromProto(request.origin()));
  }
  PORTOLAN_RETURN_IF_ERROR(server.survey->SetOrigin(origin));
  return ListControlPoints(server);
}

v1::GeoreferenceResponse GetGeoreference(const ServerContext& server,
                                         const v1::GetGeoreferenceRequest& request) {
  const std::shared_ptr<const MapSnapshot> snapshot = server.hub->Get();
  v1::GeoreferenceResponse response;
  response.set_map_version(snapshot->version);
  for (const ComponentState& component : snapshot->components) {
    if (!component.georeference) continue;
    if (request.component_id() != 0 && component.id.value() != request.component_id()) continue;
    if (response.components_size() == kMaxGeoreferencedComponents) break;
    ToProto(component, !request.summary_only(), response.add_components());
  }
  return response;
}

}  // namespace portolan
