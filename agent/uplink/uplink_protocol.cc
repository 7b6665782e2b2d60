#include "agent/uplink/uplink_protocol.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "common/wire/correction_wire.h"
#include "common/wire/geometry_wire.h"

namespace portolan {
namespace {

constexpr uint64_t kGrpcPrefixBytes = 5;
constexpr uint64_t kHttp2FrameHeaderBytes = 9;
constexpr uint64_t kHttp2FramePayloadBytes = 16384;

Status CheckLivePose(const LivePose& pose) {
  PORTOLAN_RETURN_IF_ERROR(CheckPose(pose.submap_from_camera, "submap_from_camera"));
  if (!pose.predecessor_from_submap.has_value()) return absl::OkStatus();
  return CheckPose(*pose.predecessor_from_submap, "predecessor_from_submap");
}

}  // namespace

uint64_t WireBytes(uint64_t message_bytes) {
  const uint64_t payload = message_bytes + kGrpcPrefixBytes;
  const uint64_t frames = (payload + kHttp2FramePayloadBytes - 1) / kHttp2FramePayloadBytes;
  return payload + frames * kHttp2FrameHeaderBytes;
}

Status UplinkProtocolOptions::Validate() const {
  if (window < 1) return absl::InvalidArgumentError("uplink.window: below 1");
  if (live_pose_interval < Duration::zero()) {
    return absl::InvalidArgumentError("uplink.live_pose_interval: negative");
  }
  if (offered_bytes_per_second < 0) {
    return absl::InvalidArgumentError("uplink.offered_bytes_per_second: negative");
  }
  if (max_invalid_ends < 1) return absl::InvalidArgumentError("uplink.max_invalid_ends: below 1");
  return absl::OkStatus();
}

UplinkProtocol::UplinkProtocol(Outbox* outbox, const UplinkProtocolOptions& options)
    : outbox_(outbox), options_(options) {}

v1::AgentMessage UplinkProtocol::Counted(v1::AgentMessage message) {
  stats_.sent_bytes += WireBytes(message.ByteSizeLong());
  return message;
}

v1::AgentMessage UplinkProtocol::StartStream() {
  welcomed_ = finish_sent_ = corrections_damaged_ = false;
  next_to_send_ = 0;
  unacknowledged_.clear();
  last_live_pose_.reset();
  ++stats_.streams;
  SessionHello hello = outbox_->hello();
  hello.received_map_version = stats_.received_map_version;
  hello.offered_bytes_per_second = static_cast<uint32_t>(options_.offered_bytes_per_second);
  v1::AgentMessage message;
  ToProto(hello, message.mutable_hello());
  return Counted(std::move(message));
}

std::optional<v1::AgentMessage> UplinkProtocol::Next(Duration now) {
  if (!welcomed_ || finished_) return std::nullopt;
  if (auto message = NextSubmap()) return message;
  if (auto message = NextLivePose(now)) return message;
  if (finish_requested_ && !finish_sent_ && outbox_->pending_count() == 0) {
    finish_sent_ = true;
    v1::AgentMessage message;
    message.mutable_finish();
    return Counted(std::move(message));
  }
  return std::nullopt;
}

std::optional<v1::AgentMessage> UplinkProtocol::NextSubmap() {
  while (unacknowledged_.size() < static_cast<size_t>(options_.window)) {
    const auto number = outbox_->NextPending(next_to_send_);
    if (!number.has_value()) return std::nullopt;
    auto bytes = outbox_->Read(*number);
    if (absl::IsUnavailable(bytes.status())) {
      // The disk may recover; the submap stays pending and is tried again on the next stream.
      stats_.last_error = std::string(bytes.status().message());
      next_to_send_ = *number + 1;
      continue;
    }
    next_to_send_ = *number + 1;
    if (!bytes.ok()) {
      ++stats_.corrupted_submaps;
      stats_.last_error = std::string(bytes.status().message());
      continue;
    }
    unacknowledged_.insert(*number);
    ++stats_.sent_submaps;
    v1::AgentMessage message;
    *message.mutable_submap() = MakeUpload(*number, *std::move(bytes));
    return Counted(std::move(message));
  }
  return std::nullopt;
}

std::optional<v1::AgentMessage> UplinkProtocol::NextLivePose(Duration now) {
  const auto due = NextDue();
  if (!due.has_value() || now < *due || finish_sent_) return std::nullopt;
  v1::AgentMessage message;
  ToProto(*live_pose_, message.mutable_live_pose());
  live_pose_.reset();
  last_live_pose_ = now;
  ++stats_.sent_live_poses;
  return Counted(std::move(message));
}

std::optional<Duration> UplinkProtocol::NextDue() const {
  if (!live_pose_.has_value() || !welcomed_ || finish_sent_) return std::nullopt;
  if (!last_live_pose_.has_value()) return Duration::zero();
  return *last_live_pose_ + options_.live_pose_interval;
}

void UplinkProtocol::SetLivePose(const LivePose& pose) {
  if (CheckLivePose(pose).ok()) live_pose_ = pose;
}

std::optional<MapCorrection> UplinkProtocol::OnMessage(const v1::ServerMessage& message) {
  stats_.received_bytes += WireBytes(message.ByteSizeLong());
  if (message.has_welcome() && !welcomed_) {
    OnWelcome(message.welcome());
  } else if (!welcomed_) {
    OnMalformed("message before Welcome");
  } else if (message.has_ack()) {
    OnAck(message.ack());
  } else if (message.has_correction()) {
    return OnCorrection(message.correction());
  } else if (message.has_finished() && finish_sent_) {
    // A submap that was appended after Finish went out keeps the session open.
    finished_ = outbox_->pending_count() == 0;
    finish_sent_ = finished_;
  } else {
    OnMalformed("unexpected message");
  }
  return std::nullopt;
}

void UplinkProtocol::OnWelcome(const v1::Welcome& welcome) {
  welcomed_ = true;
  stats_.connected = true;
  // A server that claims more than this session ever had is not believed; it gets everything that
  // is pending and acknowledges what it has.
  if (welcome.next_sequence_number() <= outbox_->next_sequence_number()) {
    outbox_->RemoveBelow(welcome.next_sequence_number());
  } else {
    OnMalformed("Welcome beyond the session's end");
  }
}

void UplinkProtocol::OnAck(const v1::SubmapAck& ack) {
  const Status status = CheckAck(ack);
  if (!status.ok()) return OnMalformed(std::string(status.message()));
  // Repeated acknowledgements, and such of submaps that were not sent, change nothing.
  if (unacknowledged_.erase(ack.sequence_number()) == 0) return;
  if (ack.verdict() == v1::SUBMAP_VERDICT_ACCEPTED) {
    ++stats_.accepted_submaps;
    outbox_->Remove(ack.sequence_number());
    return;
  }
  ++stats_.rejected_submaps;
  stats_.last_error = absl::StrCat("server rejected submap ", ack.sequence_number(), ": ",
                                   ack.reason().substr(0, kMaxReasonLength));
  outbox_->SetAsideRejected(ack.sequence_number(), ack.reason().substr(0, kMaxReasonLength));
}

std::optional<MapCorrection> UplinkProtocol::OnCorrection(const v1::Correction& message) {
  auto correction = FromProto(message);
  if (!correction.ok()) {
    // Not skipped over: the next stream asks for everything since the last complete version.
    corrections_damaged_ = true;
    OnMalformed(std::string(correction.status().message()));
    return std::nullopt;
  }
  ++stats_.received_corrections;
  if (!correction->more && !corrections_damaged_) {
    stats_.received_map_version = std::max(stats_.received_map_version, correction->map_version);
  }
  return *std::move(correction);
}

void UplinkProtocol::OnMalformed(const std::string& what) {
  ++stats_.malformed_messages;
  stats_.last_error = absl::StrCat("from the server: ", what);
}

void UplinkProtocol::StreamEnded(const Status& status) {
  stats_.connected = false;
  if (!status.ok() && !finished_) stats_.last_error = status.ToString();
  if (!absl::IsInvalidArgument(status) || unacknowledged_.empty()) return;
  const uint32_t first = *unacknowledged_.begin();
  suspect_ends_ = suspect_ == first ? suspect_ends_ + 1 : 1;
  suspect_ = first;
  if (suspect_ends_ < options_.max_invalid_ends) return;
  ++stats_.rejected_submaps;
  outbox_->SetAsideRejected(first, status.ToString());
  suspect_.reset();
}

}  // namespace portolan
