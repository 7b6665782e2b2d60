#include "common/wire/agent_wire.h"

#include <utility>

#include "absl/strings/str_cat.h"
#include "common/wire/crc32c.h"
#include "common/wire/geometry_wire.h"
#include "common/wire/submap_validation.h"

namespace portolan {

void ToProto(const SessionHello& hello, v1::Hello* message) {
  message->set_protocol_version(kProtocolVersion);
  message->set_agent_id(hello.agent.value());
  message->set_session_id(hello.session.value());
  ToProto(hello.camera, message->mutable_camera());
  message->set_software_version(hello.software_version.substr(0, kMaxSoftwareVersionLength));
  message->set_received_map_version(hello.received_map_version);
  message->set_offered_bytes_per_second(hello.offered_bytes_per_second);
}

StatusOr<SessionHello> FromProto(const v1::Hello& message) {
  if (message.protocol_version() < kOldestProtocolVersion ||
      message.protocol_version() > kProtocolVersion) {
    return absl::FailedPreconditionError(
        absl::StrCat("hello.protocol_version: ", message.protocol_version(),
                     "; this program speaks ", kOldestProtocolVersion, " to ", kProtocolVersion));
  }
  SessionHello hello;
  hello.protocol_version = message.protocol_version();
  hello.agent = AgentId(message.agent_id());
  hello.session = SessionId(message.session_id());
  PORTOLAN_RETURN_IF_ERROR(ValidateSession(hello.agent, hello.session));
  PORTOLAN_ASSIGN_OR_RETURN(hello.camera, FromProto(message.camera(), "hello.camera"));
  if (message.software_version().size() > kMaxSoftwareVersionLength) {
    return absl::InvalidArgumentError("hello.software_version: too long");
  }
  hello.software_version = message.software_version();
  hello.received_map_version = message.received_map_version();
  hello.offered_bytes_per_second = message.offered_bytes_per_second();
  return hello;
}

void ToProto(const LivePose& pose, v1::LivePose* message) {
  message->set_time_ns(pose.time.count());
  message->set_sequence_number(pose.sequence_number);
  AppendPose(pose.submap_from_camera, message->mutable_submap_from_camera());
  if (pose.predecessor_from_submap.has_value()) {
    AppendPose(*pose.predecessor_from_submap, message->mutable_predecessor_from_submap());
  }
}

StatusOr<LivePose> FromProto(const v1::LivePose& message) {
  LivePose pose;
  pose.time = Timestamp(message.time_ns());
  if (pose.time < Timestamp::zero() || pose.time > kMaxTime) {
    return absl::InvalidArgumentError("live_pose.time_ns: out of range");
  }
  pose.sequence_number = message.sequence_number();
  if (message.submap_from_camera_size() != kPoseNumbers) {
    return absl::InvalidArgumentError("live_pose.submap_from_camera: not 7 numbers");
  }
  PORTOLAN_ASSIGN_OR_RETURN(pose.submap_from_camera, PoseAt(message.submap_from_camera(), 0,
                                                            "live_pose.submap_from_camera"));
  if (message.predecessor_from_submap_size() == 0) return pose;
  if (message.predecessor_from_submap_size() != kPoseNumbers) {
    return absl::InvalidArgumentError("live_pose.predecessor_from_submap: neither 0 nor 7 numbers");
  }
  PORTOLAN_ASSIGN_OR_RETURN(
      pose.predecessor_from_submap,
      PoseAt(message.predecessor_from_submap(), 0, "live_pose.predecessor_from_submap"));
  return pose;
}

v1::SubmapUpload MakeUpload(uint32_t sequence_number, std::string submap_bytes) {
  v1::SubmapUpload message;
  message.set_sequence_number(sequence_number);
  message.set_crc32c(Crc32c(submap_bytes));
  message.set_submap(std::move(submap_bytes));
  return message;
}

Status CheckUpload(const v1::SubmapUpload& message) {
  if (message.submap().size() > kMaxSubmapBytes) {
    return absl::InvalidArgumentError(absl::StrCat(
        "submap_upload.submap: ", message.submap().size(), " bytes, more than ", kMaxSubmapBytes));
  }
  if (Crc32c(message.submap()) != message.crc32c()) {
    return absl::InvalidArgumentError("submap_upload.crc32c: does not match");
  }
  return absl::OkStatus();
}

Status CheckAck(const v1::SubmapAck& message) {
  if (message.verdict() == v1::SUBMAP_VERDICT_ACCEPTED ||
      message.verdict() == v1::SUBMAP_VERDICT_REJECTED) {
    return absl::OkStatus();
  }
  return absl::InvalidArgumentError("ack.verdict: unknown value");
}

}  // namespace portolan
