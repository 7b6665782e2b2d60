#include "server/rpc/agent_stream.h"

#include <utility>

#include "common/base/concat.h"
#include "common/base/logging.h"
#include "common/wire/correction_wire.h"
#include "server/rpc/agent_streams.h"
#include "server/rpc/grpc_status.h"

namespace portolan {
namespace {

// An agent has one submap in flight that waits for its verdict, and is sent corrections one after
// the other: one that lets so many messages lie does not read.
constexpr size_t kMaxOutgoing = 1024;

}  // namespace

std::shared_ptr<AgentStream> AgentStream::Start(const ServerContext& server,
                                                std::shared_ptr<AgentStreams> streams,
                                                grpc::CallbackServerContext* call) {
  std::shared_ptr<AgentStream> stream(new AgentStream(server, std::move(streams), call));
  stream->self_ = stream;
  stream->Read();
  return stream;
}

void AgentStream::Read() {
  {
    const std::lock_guard lock(mutex_);
    if (end_) return;
    ++starting_;
  }
  StartRead(&incoming_);
  {
    const std::lock_guard lock(mutex_);
    --starting_;
  }
  Advance();
}

void AgentStream::OnReadDone(bool ok) {
  if (ok) {
    Handle(incoming_);
  } else if (!finish_requested_) {
    End(absl::OkStatus());  // the agent closed its side; if it is gone, nobody reads the status
  }
}

void AgentStream::Handle(const v1::AgentMessage& message) {
  if (!session_ && message.message_case() != v1::AgentMessage::kHello) {
    return End(absl::InvalidArgumentError("the first message must be hello"));
  }
  switch (message.message_case()) {
    case v1::AgentMessage::kHello:
      return HandleHello(message.hello());
    case v1::AgentMessage::kSubmap:
      return HandleSubmap(message.submap());
    case v1::AgentMessage::kLivePose:
      return HandleLivePose(message.live_pose());
    case v1::AgentMessage::kFinish:
      return HandleFinish();
    case v1::AgentMessage::MESSAGE_NOT_SET:
      return Read();  // a message of a later protocol
  }
}

void AgentStream::HandleHello(const v1::Hello& message) {
  if (session_) return End(absl::InvalidArgumentError("a second hello"));
  const StatusOr<SessionHello> hello = FromProto(message);
  if (!hello.ok()) return End(hello.status());
  const SessionName session{hello->agent, hello->session};
  const StatusOr<uint32_t> next = server_.ingest->OpenSession(*hello);
  if (!next.ok()) return End(next.status());
  session_ = session;
  protocol_version_ = hello->protocol_version;
  if (const auto older = streams_->Register(session, shared_from_this())) {
    older->End(absl::AbortedError("the session connected a second time"));
  }
  LogInfo("agent ", session.agent.value(), " connected, ", *next, " submaps of this session known");
  v1::ServerMessage welcome;
  welcome.mutable_welcome()->set_next_sequence_number(*next);
  welcome.mutable_welcome()->set_map_version(server_.hub->Get()->version);
  Write(std::move(welcome));
  server_.corrections->Connect({session.agent, session.session}, hello->received_map_version,
                               weak_from_this(), hello->offered_bytes_per_second);
  Read();
}

void AgentStream::HandleSubmap(const v1::SubmapUpload& message) {
  const uint32_t number = message.sequence_number();
  server_.ingest->Submit(*session_, message,
                         [self = shared_from_this(), number](StatusOr<IngestVerdict> verdict) {
                           if (!verdict.ok()) return self->End(verdict.status());
                           v1::ServerMessage message;
                           v1::SubmapAck* ack = message.mutable_ack();
                           ack->set_sequence_number(number);
                           ack->set_verdict(verdict->accepted ? v1::SUBMAP_VERDICT_ACCEPTED
                                                              : v1::SUBMAP_VERDICT_REJECTED);
                           ack->set_reason(verdict->reason.substr(0, kMaxReasonLength));
                           self->Write(std::move(message));
                           self->Read();
                         });
}

void AgentStream::HandleLivePose(const v1::LivePose& message) {
  const StatusOr<LivePose> pose = FromProto(message);
  if (!pose.ok()) return End(pose.status());
  server_.sessions->SetLivePose(*session_, *pose);
  Read();
}

void AgentStream::HandleFinish() {
  if (std::exchange(finish_requested_, true)) return Read();
  server_.ingest->FinishSession(*session_, [weak = weak_from_this()](const Status& status) {
    const auto self = weak.lock();
    if (!self) return;
    if (!status.ok()) return self->End(status);
    self->FinishWhenSettled();
  });
  Read();
}

void AgentStream::FinishWhenSettled() {
  server_.map_thread->WhenSettled([weak = weak_from_this()](uint64_t) {
    const auto self = weak.lock();
    if (!self) return;
    const auto say_finished = [weak](uint64_t map_version) {
      const auto self = weak.lock();
      if (!self) return;
      v1::ServerMessage message;
      message.mutable_finished()->set_map_version(map_version);
      self->Write(std::move(message));
      self->End(absl::OkStatus());
    };
    self->server_.corrections->Flush({self->session_->agent, self->session_->session},
                                     say_finished);
  });
}

bool AgentStream::IsReady() const {
  const std::lock_guard lock(mutex_);
  return corrections_outgoing_ == 0 && !end_;
}

void AgentStream::Send(const MapCorrection& correction) {
  std::vector<MapCorrection> parts = SplitCorrection(correction);
  parts.back().more |= correction.more;
  for (const MapCorrection& part : parts) {
    v1::ServerMessage message;
    ToProto(part, protocol_version_, message.mutable_correction());
    Write(std::move(message));
  }
}

std::optional<LivePose> AgentStream::NewestPose() const {
  const auto status = server_.sessions->Find(*session_);
  return status ? status->live_pose : std::nullopt;
}

void AgentStream::Write(v1::ServerMessage message) {
  bool is_read = true;
  {
    const std::lock_guard lock(mutex_);
    if (end_) return;
    is_read = outgoing_.size() < kMaxOutgoing;
    if (is_read) {
      if (message.has_correction()) ++corrections_outgoing_;
      outgoing_.push_back(std::move(message));
    } else {
      has_failed_ = true;
      end_ = absl::ResourceExhaustedError("the agent does not read its answers");
      ++starting_;
    }
  }
  if (!is_read) Cancel();
  Advance();
}

void AgentStream::Cancel() {
  LogWarning("agent ", session_->agent.value(),
             " does not read its answers: ", "its stream is ended");
  call_->TryCancel();
  const std::lock_guard lock(mutex_);
  --starting_;
}

void AgentStream::OnWriteDone(bool ok) {
  bool was_correction = false;
  {
    const std::lock_guard lock(mutex_);
    is_writing_ = false;
    was_correction = outgoing_.front().has_correction();
    corrections_outgoing_ -= was_correction;
    outgoing_.pop_front();
    has_failed_ |= !ok;
  }
  if (!ok) End(absl::CancelledError("the agent is gone"));
  Advance();
  if (was_correction) server_.corrections->Wake();
}

void AgentStream::End(const Status& status) {
  {
    const std::lock_guard lock(mutex_);
    if (!end_) end_ = status;
  }
  Advance();
}

void AgentStream::OnCancel() {
  {
    const std::lock_guard lock(mutex_);
    has_failed_ = true;
  }
  End(absl::CancelledError("the agent is gone"));
}

void AgentStream::Advance() {
  const v1::ServerMessage* to_write = nullptr;
  std::optional<Status> to_finish;
  {
    const std::lock_guard lock(mutex_);
    if (is_writing_ || is_finished_) return;
    if (!outgoing_.empty() && !has_failed_) {
      is_writing_ = true;
      to_write = &outgoing_.front();
    } else if (end_ && starting_ == 0) {
      is_finished_ = true;
      to_finish = end_;
    }
  }
  if (to_write) StartWrite(to_write);
  if (to_finish) Finish(ToGrpc(*to_finish));
}

void AgentStream::OnDone() {
  if (streams_->Leave(session_ ? &*session_ : nullptr, this)) {
    LogInfo("agent ", session_->agent.value(), " disconnected");
  }
  // May destroy this.
  std::exchange(self_, nullptr).reset();
}

}  // namespace portolan
