#include "server/rpc/map_service.h"

#include "server/rpc/follow_changes.h"
#include "server/rpc/map_handlers.h"
#include "server/rpc/page_writer.h"
#include "server/rpc/settle.h"

namespace portolan {

grpc::ServerUnaryReactor* MapServiceImpl::GetMapInfo(grpc::CallbackServerContext* context,
                                                     const v1::GetMapInfoRequest*,
                                                     v1::MapInfo* response) {
  *response = portolan::GetMapInfo(server_);
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  reactor->Finish(grpc::Status::OK);
  return reactor;
}

grpc::ServerUnaryReactor* MapServiceImpl::ListAgents(grpc::CallbackServerContext* context,
                                                     const v1::ListAgentsRequest*,
                                                     v1::ListAgentsResponse* response) {
  *response = portolan::ListAgents(server_);
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  reactor->Finish(grpc::Status::OK);
  return reactor;
}

grpc::ServerWriteReactor<v1::SubmapPage>* MapServiceImpl::ListSubmaps(
    grpc::CallbackServerContext*, const v1::ListSubmapsRequest* request) {
  return new PageWriter<v1::SubmapPage>(portolan::ListSubmaps(server_, *request));
}

grpc::ServerWriteReactor<v1::LandmarkPage>* MapServiceImpl::QueryLandmarks(
    grpc::CallbackServerContext*, const v1::QueryLandmarksRequest* request) {
  return new PageWriter<v1::LandmarkPage>(portolan::QueryLandmarks(server_, *request));
}

grpc::ServerWriteReactor<v1::TrajectorySegment>* MapServiceImpl::GetTrajectory(
    grpc::CallbackServerContext*, const v1::GetTrajectoryRequest* request) {
  return new PageWriter<v1::TrajectorySegment>(portolan::GetTrajectory(server_, *request));
}

grpc::ServerWriteReactor<v1::PoseGraphPage>* MapServiceImpl::GetPoseGraph(
    grpc::CallbackServerContext*, const v1::GetPoseGraphRequest* request) {
  return new PageWriter<v1::PoseGraphPage>(portolan::GetPoseGraph(server_, *request));
}

grpc::ServerWriteReactor<v1::MapChange>* MapServiceImpl::FollowChanges(
    grpc::CallbackServerContext*, const v1::FollowChangesRequest* request) {
  return FollowChangesStream::Start(server_, *request);
}

grpc::ServerUnaryReactor* MapServiceImpl::Settle(grpc::CallbackServerContext*,
                                                 const v1::SettleRequest*,
                                                 v1::SettleResponse* response) {
  return SettleCall::Start(server_, response);
}

}  // namespace portolan
