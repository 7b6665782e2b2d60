// Reads a server's map: the calls of MapService as functions that return whole results. The command
// line, viewers and other programs use it.
#ifndef PORTOLAN_COMMON_CLIENT_MAP_CLIENT_H_
#define PORTOLAN_COMMON_CLIENT_MAP_CLIENT_H_

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/time.h"
#include "proto/map_service.pb.h"

namespace grpc {
class Channel;
}

namespace portolan {

// The messages are those of proto/map_service.proto; pages of a stream come joined into one.
// Errors: the server's, or Unavailable with the address if there is none, or DeadlineExceeded.
// Thread-safe.
class MapClient {
 public:
  // `address`: host:port. Nothing is sent before the first call.
  explicit MapClient(const std::string& address, Duration timeout = std::chrono::seconds(30));
  MapClient(std::shared_ptr<grpc::Channel> channel, const std::string& address, Duration timeout);
  ~MapClient();

  StatusOr<v1::MapInfo> GetMapInfo() const;
  StatusOr<v1::ListAgentsResponse> ListAgents() const;
  StatusOr<v1::SubmapPage> ListSubmaps(const v1::ListSubmapsRequest& request) const;
  // The agents' numbers refer to the joined page's list.
  StatusOr<v1::LandmarkPage> QueryLandmarks(const v1::QueryLandmarksRequest& request) const;
  StatusOr<std::vector<v1::TrajectorySegment>> GetTrajectory(
      const v1::GetTrajectoryRequest& request) const;
  StatusOr<v1::PoseGraphPage> GetPoseGraph(const v1::GetPoseGraphRequest& request) const;
  // Calls `on_change` for each message until it returns false (then OK) or the stream breaks. No
  // time limit.
  Status FollowChanges(uint64_t since_version,
                       const std::function<bool(const v1::MapChange&)>& on_change) const;
  // Waits until the map has settled; returns its version.
  StatusOr<uint64_t> Settle(Duration timeout) const;
  StatusOr<v1::ControlPoints> ListControlPoints() const;
  StatusOr<v1::ControlPoints> AddControlPoints(const v1::AddControlPointsRequest& request) const;
  StatusOr<v1::ControlPoints> RemoveControlPoints(
      const v1::RemoveControlPointsRequest& request) const;
  StatusOr<v1::ControlPoints> SetSiteOrigin(const v1::SetSiteOriginRequest& request) const;
  StatusOr<v1::GeoreferenceResponse> GetGeoreference(
      const v1::GetGeoreferenceRequest& request) const;

 private:
  class Calls;
  std::unique_ptr<Calls> calls_;
};

}  // namespace portolan

#endif  // PORTOLAN_COMMON_CLIENT_MAP_CLIENT_H_
