// The other messages of the agent's stream (proto/agent_service.proto).
#ifndef PORTOLAN_COMMON_WIRE_AGENT_WIRE_H_
#define PORTOLAN_COMMON_WIRE_AGENT_WIRE_H_

#include <cstdint>
#include <optional>
#include <string>

#include "common/base/status.h"
#include "common/base/strong_id.h"
#include "common/base/time.h"
#include "common/camera/camera_model.h"
#include "common/geometry/rigid3.h"
#include "proto/agent_service.pb.h"

namespace portolan {

// What this program says in Hello, and the oldest that it still understands.
inline constexpr uint32_t kProtocolVersion = 2;
inline constexpr uint32_t kOldestProtocolVersion = 1;
inline constexpr size_t kMaxSoftwareVersionLength = 128;
inline constexpr size_t kMaxReasonLength = 512;

// What an agent says of itself and its session.
struct SessionHello {
  AgentId agent;
  SessionId session;
  CameraIntrinsics camera;
  std::string software_version;
  // That the agent speaks; ToProto says kProtocolVersion whatever stands here.
  uint32_t protocol_version = kProtocolVersion;
  // Newest map version whose corrections the agent holds completely; 0 for none.
  uint64_t received_map_version = 0;
  // What the agent wants of landmark offers, bytes a second.
  uint32_t offered_bytes_per_second = 0;
};

// The agent's pose of this instant in the submap that it is building.
struct LivePose {
  Timestamp time{};
  uint32_t sequence_number = 0;
  Rigid3 submap_from_camera;
  // Of the open submap if it is connected to its predecessor.
  std::optional<Rigid3> predecessor_from_submap;
};

// FailedPrecondition for another protocol version, InvalidArgument for what is malformed. The
// camera is not yet judged by CameraModel::Create.
void ToProto(const SessionHello& hello, v1::Hello* message);
StatusOr<SessionHello> FromProto(const v1::Hello& message);

void ToProto(const LivePose& pose, v1::LivePose* message);
StatusOr<LivePose> FromProto(const v1::LivePose& message);

// Wraps the bytes of EncodeSubmap.
v1::SubmapUpload MakeUpload(uint32_t sequence_number, std::string submap_bytes);
// InvalidArgument if the size or the checksum is wrong. DecodeSubmap then reads `submap`; the
// receiver compares its key with the session and with sequence_number.
Status CheckUpload(const v1::SubmapUpload& message);

// Verdict known.
Status CheckAck(const v1::SubmapAck& message);

}  // namespace portolan

#endif  // PORTOLAN_COMMON_WIRE_AGENT_WIRE_H_
