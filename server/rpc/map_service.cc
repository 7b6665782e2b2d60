#include "server/rpc/map_service.h"

#include <utility>

#include "server/rpc/follow_changes.h"
#include "server/rpc/grpc_status.h"
#include "server/rpc/map_handlers.h"
#include "server/rpc/page_writer.h"
#include "server/rpc/settle.h"

namespace portolan {
namespace {

template <typename Response>
grpc::ServerUnaryReactor* Answer(grpc::CallbackServerContext* context, StatusOr<Response> result,
                                 Response* response) {
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  if (result.ok()) *response = *std::move(result);
  reactor->Finish(ToGrpc(result.status()));
  return reactor;
}

}  // namespace

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

grpc::ServerUnaryReactor* MapServiceImpl::ListControlPoints(grpc::CallbackServerContext* context,
                                                            const v1::ListControlPointsRequest*,
                                                            v1::ControlPoints* response) {
  return Answer<v1::ControlPoints>(context, portolan::ListControlPoints(server_), response);
}

grpc::ServerUnaryReactor* MapServiceImpl::AddControlPoints(
    grpc::CallbackServerContext* context, const v1::AddControlPointsRequest* request,
    v1::ControlPoints* response) {
  return Answer(context, portolan::AddControlPoints(server_, *request), response);
}

grpc::ServerUnaryReactor* MapServiceImpl::RemoveControlPoints(
    grpc::CallbackServerContext* context, const v1::RemoveControlPointsRequest* request,
    v1::ControlPoints* response) {
  return Answer(context, portolan::RemoveControlPoints(server_, *request), response);
}

grpc::ServerUnaryReactor* MapServiceImpl::SetSiteOrigin(grpc::CallbackServerContext* context,
                                                        const v1::SetSiteOriginRequest* request,
                                                        v1::ControlPoints* response) {
  return Answer(context, portolan::SetSiteOrigin(server_, *request), response);
}

grpc::ServerUnaryReactor* MapServiceImpl::GetGeoreference(grpc::CallbackServerContext* context,
                                                          const v1::GetGeoreferenceRequest* request,
                                                          v1::GeoreferenceResponse* response) {
  return Answer<v1::GeoreferenceResponse>(context, portolan::GetGeoreference(server_, *request),
                                          response);
}

}  // namespace portolan
