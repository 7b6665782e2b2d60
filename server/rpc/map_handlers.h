// One function a call of MapService, each in the file of its name: reads one version of the map
// and fills messages (proto/map_service.proto says what each field means). Thread-safe.
#ifndef PORTOLAN_SERVER_RPC_MAP_HANDLERS_H_
#define PORTOLAN_SERVER_RPC_MAP_HANDLERS_H_

#include <functional>

#include "common/base/status.h"
#include "proto/map_service.pb.h"
#include "server/rpc/server_context.h"

namespace portolan {

// Fills the next page of a stream; false: no more pages.
template <typename Page>
using PageMaker = std::function<bool(Page*)>;

v1::MapInfo GetMapInfo(const ServerContext& server);
v1::ListAgentsResponse ListAgents(const ServerContext& server);
PageMaker<v1::SubmapPage> ListSubmaps(const ServerContext& server,
                                      const v1::ListSubmapsRequest& request);
StatusOr<PageMaker<v1::LandmarkPage>> QueryLandmarks(const ServerContext& server,
                                                     const v1::QueryLandmarksRequest& request);
StatusOr<PageMaker<v1::TrajectorySegment>> GetTrajectory(const ServerContext& server,
                                                         const v1::GetTrajectoryRequest& request);
PageMaker<v1::PoseGraphPage> GetPoseGraph(const ServerContext& server,
                                          const v1::GetPoseGraphRequest& request);
v1::ControlPoints ListControlPoints(const ServerContext& server);
StatusOr<v1::ControlPoints> AddControlPoints(const ServerContext& server,
                                             const v1::AddControlPointsRequest& request);
StatusOr<v1::ControlPoints> RemoveControlPoints(const ServerContext& server,
                                                const v1::RemoveControlPointsRequest& request);
StatusOr<v1::ControlPoints> SetSiteOrigin(const ServerContext& server,
                                          const v1::SetSiteOriginRequest& request);
v1::GeoreferenceResponse GetGeoreference(const ServerContext& server,
                                         const v1::GetGeoreferenceRequest& request);

// Used by several calls.
void FillSubmapInfo(const SubmapState& state, const SessionTable& sessions,
                    v1::SubmapInfo* message);
bool IsQuarantined(const SubmapState& state);
bool IsMetric(const MapSnapshot& snapshot, ComponentId component);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_RPC_MAP_HANDLERS_H_
