// MapService on gRPC's callback interface: each call goes to the handler of its name.
#ifndef PORTOLAN_SERVER_RPC_MAP_SERVICE_H_
#define PORTOLAN_SERVER_RPC_MAP_SERVICE_H_

#include <grpcpp/grpcpp.h>

#include "proto/map_service.grpc.pb.h"
#include "server/rpc/server_context.h"

namespace portolan {

// Thread-safe.
class MapServiceImpl : public v1::MapService::CallbackService {
 public:
  explicit MapServiceImpl(const ServerContext& server) : server_(server) {}

  grpc::ServerUnaryReactor* GetMapInfo(grpc::CallbackServerContext* context,
                                       const v1::GetMapInfoRequest* request,
                                       v1::MapInfo* response) override;
  grpc::ServerUnaryReactor* ListAgents(grpc::CallbackServerContext* context,
                                       const v1::ListAgentsRequest* request,
                                       v1::ListAgentsResponse* response) override;
  grpc::ServerWriteReactor<v1::SubmapPage>* ListSubmaps(
      grpc::CallbackServerContext* context, const v1::ListSubmapsRequest* request) override;
  grpc::ServerWriteReactor<v1::LandmarkPage>* QueryLandmarks(
      grpc::CallbackServerContext* context, const v1::QueryLandmarksRequest* request) override;
  grpc::ServerWriteReactor<v1::TrajectorySegment>* GetTrajectory(
      grpc::CallbackServerContext* context, const v1::GetTrajectoryRequest* request) override;
  grpc::ServerWriteReactor<v1::PoseGraphPage>* GetPoseGraph(
      grpc::CallbackServerContext* context, const v1::GetPoseGraphRequest* request) override;
  grpc::ServerWriteReactor<v1::MapChange>* FollowChanges(
      grpc::CallbackServerContext* context, const v1::FollowChangesRequest* request) override;
  grpc::ServerUnaryReactor* Settle(grpc::CallbackServerContext* context,
                                   const v1::SettleRequest* request,
                                   v1::SettleResponse* response) override;
  grpc::ServerUnaryReactor* ListControlPoints(grpc::CallbackServerContext* context,
                                              const v1::ListControlPointsRequest* request,
                                              v1::ControlPoints* response) override;
  grpc::ServerUnaryReactor* AddControlPoints(grpc::CallbackServerContext* context,
                                             const v1::AddControlPointsRequest* request,
                                             v1::ControlPoints* response) override;
  grpc::ServerUnaryReactor* RemoveControlPoints(grpc::CallbackServerContext* context,
                                                const v1::RemoveControlPointsRequest* request,
                                                v1::ControlPoints* response) override;
  grpc::ServerUnaryReactor* SetSiteOrigin(grpc::CallbackServerContext* context,
                                          const v1::SetSiteOriginRequest* request,
                                          v1::ControlPoints* response) override;
  grpc::ServerUnaryReactor* GetGeoreference(grpc::CallbackServerContext* context,
                                            const v1::GetGeoreferenceRequest* request,
                                            v1::GeoreferenceResponse* response) override;

 private:
  const ServerContext server_;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_RPC_MAP_SERVICE_H_
