#include "common/client/map_client.h"

#include <grpcpp/grpcpp.h>

#include <chrono>
#include <map>
#include <utility>

#include "common/base/concat.h"
#include "proto/map_service.grpc.pb.h"

namespace portolan {
namespace {

Status FromGrpc(const grpc::Status& status, const std::string& address) {
  if (status.ok()) return absl::OkStatus();
  return Status(static_cast<absl::StatusCode>(status.error_code()),
                Concat("server ", address, ": ", status.error_message()));
}

// Moves a page's landmarks to the end of `all`, renumbering their agents.
void Append(v1::LandmarkPage* page, std::map<std::string, uint32_t>* numbers,
            v1::LandmarkPage* all) {
  std::vector<uint32_t> new_number;
  for (const std::string& agent : page->agent_ids()) {
    const auto [entry, is_new] = numbers->try_emplace(agent, all->agent_ids_size());
    if (is_new) all->add_agent_ids(agent);
    new_number.push_back(entry->second);
  }
  for (v1::Landmark& landmark : *page->mutable_landmarks()) {
    for (uint32_t& agent : *landmark.mutable_agents()) {
      agent = agent < new_number.size() ? new_number[agent] : 0;
    }
    *all->add_landmarks() = std::move(landmark);
  }
}

}  // namespace

class MapClient::Calls {
 public:
  Calls(std::shared_ptr<grpc::Channel> channel, std::string address, Duration timeout)
      : stub_(v1::MapService::NewStub(std::move(channel))),
        address_(std::move(address)),
        timeout_(timeout) {}

  template <typename Request, typename Response>
  StatusOr<Response> Unary(grpc::Status (v1::MapService::Stub::*call)(grpc::ClientContext*,
                                                                      const Request&, Response*),
                           const Request& request, Duration timeout) const {
    grpc::ClientContext context;
    context.set_deadline(Deadline(timeout));
    Response response;
    PORTOLAN_RETURN_IF_ERROR(
        FromGrpc((stub_.get()->*call)(&context, request, &response), address_));
    return response;
  }

  // Calls `on_page` for each message of a stream.
  template <typename Request, typename Page, typename OnPage>
  Status Stream(std::unique_ptr<grpc::ClientReader<Page>> (v1::MapService::Stub::*call)(
                    grpc::ClientContext*, const Request&),
                const Request& request, OnPage on_page) const {
    grpc::ClientContext context;
    context.set_deadline(Deadline(timeout_));
    const auto reader = (stub_.get()->*call)(&context, request);
    Page page;
    while (reader->Read(&page)) on_page(&page);
    return FromGrpc(reader->Finish(), address_);
  }

  Status Follow(const v1::FollowChangesRequest& request,
                const std::function<bool(const v1::MapChange&)>& on_change) const {
    grpc::ClientContext context;
    const auto reader = stub_->FollowChanges(&context, request);
    v1::MapChange change;
    while (reader->Read(&change)) {
      if (on_change(change)) continue;
      context.TryCancel();
      reader->Finish();
      return absl::OkStatus();
    }
    return FromGrpc(reader->Finish(), address_);
  }

  Duration timeout() const { return timeout_; }

 private:
  static std::chrono::system_clock::time_point Deadline(Duration timeout) {
    return std::chrono::system_clock::now() +
           std::chrono::duration_cast<std::chrono::system_clock::duration>(timeout);
  }

  const std::unique_ptr<v1::MapService::Stub> stub_;
  const std::string address_;
  const Duration timeout_;
};

MapClient::MapClient(const std::string& address, Duration timeout)
    : MapClient(grpc::CreateChannel(address, grpc::InsecureChannelCredentials()), address,
                timeout) {}

MapClient::MapClient(std::shared_ptr<grpc::Channel> channel, const std::string& address,
                     Duration timeout)
    : calls_(std::make_unique<Calls>(std::move(channel), address, timeout)) {}

MapClient::~MapClient() = default;

StatusOr<v1::MapInfo> MapClient::GetMapInfo() const {
  return calls_->Unary(&v1::MapService::Stub::GetMapInfo, v1::GetMapInfoRequest(),
                       calls_->timeout());
}

StatusOr<v1::ListAgentsResponse> MapClient::ListAgents() const {
  return calls_->Unary(&v1::MapService::Stub::ListAgents, v1::ListAgentsRequest(),
                       calls_->timeout());
}

StatusOr<v1::SubmapPage> MapClient::ListSubmaps(const v1::ListSubmapsRequest& request) const {
  v1::SubmapPage all;
  PORTOLAN_RETURN_IF_ERROR(calls_->Stream(&v1::MapService::Stub::ListSubmaps, request,
                                          [&](v1::SubmapPage* page) { all.MergeFrom(*page); }));
  return all;
}

StatusOr<v1::LandmarkPage> MapClient::QueryLandmarks(
    const v1::QueryLandmarksRequest& request) const {
  v1::LandmarkPage all;
  std::map<std::string, uint32_t> numbers;
  PORTOLAN_RETURN_IF_ERROR(
      calls_->Stream(&v1::MapService::Stub::QueryLandmarks, request, [&](v1::LandmarkPage* page) {
        all.set_map_version(page->map_version());
        all.set_component_id(page->component_id());
        all.set_metric(page->metric());
        Append(page, &numbers, &all);
      }));
  return all;
}

StatusOr<std::vector<v1::TrajectorySegment>> MapClient::GetTrajectory(
    const v1::GetTrajectoryRequest& request) const {
  std::vector<v1::TrajectorySegment> segments;
  PORTOLAN_RETURN_IF_ERROR(calls_->Stream(
      &v1::MapService::Stub::GetTrajectory, request,
      [&](v1::TrajectorySegment* segment) { segments.push_back(std::move(*segment)); }));
  return segments;
}

StatusOr<v1::PoseGraphPage> MapClient::GetPoseGraph(const v1::GetPoseGraphRequest& request) const {
  v1::PoseGraphPage all;
  PORTOLAN_RETURN_IF_ERROR(calls_->Stream(&v1::MapService::Stub::GetPoseGraph, request,
                                          [&](v1::PoseGraphPage* page) { all.MergeFrom(*page); }));
  return all;
}

Status MapClient::FollowChanges(uint64_t since_version,
                                const std::function<bool(const v1::MapChange&)>& on_change) const {
  v1::FollowChangesRequest request;
  request.set_since_version(since_version);
  return calls_->Follow(request, on_change);
}

StatusOr<uint64_t> MapClient::Settle(Duration timeout) const {
  PORTOLAN_ASSIGN_OR_RETURN(
      const v1::SettleResponse response,
      calls_->Unary(&v1::MapService::Stub::Settle, v1::SettleRequest(), timeout));
  return response.map_version();
}

StatusOr<v1::ControlPoints> MapClient::ListControlPoints() const {
  return calls_->Unary(&v1::MapService::Stub::ListControlPoints, v1::ListControlPointsRequest(),
                       calls_->timeout());
}

StatusOr<v1::ControlPoints> MapClient::AddControlPoints(
    const v1::AddControlPointsRequest& request) const {
  return calls_->Unary(&v1::MapService::Stub::AddControlPoints, request, calls_->timeout());
}

StatusOr<v1::ControlPoints> MapClient::RemoveControlPoints(
    const v1::RemoveControlPointsRequest& request) const {
  return calls_->Unary(&v1::MapService::Stub::RemoveControlPoints, request, calls_->timeout());
}

StatusOr<v1::ControlPoints> MapClient::SetSiteOrigin(
    const v1::SetSiteOriginRequest& request) const {
  return calls_->Unary(&v1::MapService::Stub::SetSiteOrigin, request, calls_->timeout());
}

StatusOr<v1::GeoreferenceResponse> MapClient::GetGeoreference(
    const v1::GetGeoreferenceRequest& request) const {
  return calls_->Unary(&v1::MapService::Stub::GetGeoreference, request, calls_->timeout());
}

}  // namespace portolan
