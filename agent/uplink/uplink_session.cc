#include "agent/uplink/uplink_session.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "common/base/check.h"
#include "common/wire/submap_wire.h"
#include "grpcpp/grpcpp.h"
#include "proto/agent_service.grpc.pb.h"

namespace portolan {
namespace {

constexpr Duration kLongestWait = std::chrono::hours(24 * 365);

int ToMilliseconds(Duration duration) {
  return static_cast<int>(std::chrono::duration_cast<std::chrono::milliseconds>(duration).count());
}

// A channel of its own for each attempt: the back-off is ours alone.
std::shared_ptr<grpc::Channel> CreateChannel(const UplinkOptions& options) {
  grpc::ChannelArguments arguments;
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  arguments.SetInt(GRPC_ARG_MIN_RECONNECT_BACKOFF_MS, ToMilliseconds(options.connect_timeout));
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIME_MS, ToMilliseconds(options.keepalive_interval));
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, ToMilliseconds(options.keepalive_timeout));
  arguments.SetInt(GRPC_ARG_HTTP2_MAX_PINGS_WITHOUT_DATA, 0);
  return grpc::CreateCustomChannel(options.server_address, grpc::InsecureChannelCredentials(),
                                   arguments);
}

Status FromGrpc(const grpc::Status& status) {
  return Status(static_cast<absl::StatusCode>(status.error_code()), status.error_message());
}

}  // namespace

struct UplinkSession::Stream {
  grpc::ClientContext context;
  std::unique_ptr<grpc::ClientReaderWriter<v1::AgentMessage, v1::ServerMessage>> rpc;
  bool ended = false;  // guarded by mutex_: nothing more to read
};

Status UplinkOptions::Validate() const {
  PORTOLAN_RETURN_IF_ERROR(protocol.Validate());
  PORTOLAN_RETURN_IF_ERROR(backoff.Validate());
  if (server_address.empty()) return absl::InvalidArgumentError("uplink.server_address: empty");
  const auto is_sane = [](Duration d) {
    return d >= std::chrono::milliseconds(1) && d <= std::chrono::hours(1);
  };
  if (!is_sane(connect_timeout)) {
    return absl::InvalidArgumentError("uplink.connect_timeout: not in 1 ms .. 1 h");
  }
  if (!is_sane(keepalive_interval) || keepalive_interval < std::chrono::seconds(10)) {
    return absl::InvalidArgumentError("uplink.keepalive_interval: not in 10 s .. 1 h");
  }
  if (!is_sane(keepalive_timeout)) {
    return absl::InvalidArgumentError("uplink.keepalive_timeout: not in 1 ms .. 1 h");
  }
  return absl::OkStatus();
}

StatusOr<std::unique_ptr<UplinkSession>> UplinkSession::Create(const UplinkOptions& options,
                                                               std::unique_ptr<Outbox> outbox,
                                                               uint64_t jitter_seed,
                                                               CorrectionCallback on_correction,
                                                               Clock* clock) {
  PORTOLAN_RETURN_IF_ERROR(options.Validate());
  return std::unique_ptr<UplinkSession>(
      new UplinkSession(options, std::move(outbox), jitter_seed, std::move(on_correction), clock));
}

UplinkSession::UplinkSession(const UplinkOptions& options, std::unique_ptr<Outbox> outbox,
                             uint64_t jitter_seed, CorrectionCallback on_correction, Clock* clock)
    : options_(options),
      outbox_(std::move(outbox)),
      on_correction_(std::move(on_correction)),
      clock_(clock),
      backoff_(options.backoff, jitter_seed, clock),
      protocol_(outbox_.get(), options.protocol) {}

UplinkSession::~UplinkSession() { Shutdown(); }

void UplinkSession::Start() {
  PORTOLAN_CHECK(!thread_.joinable());
  thread_ = std::thread([this] { Run(); });
}

Status UplinkSession::Submit(const Submap& submap) {
  const SessionHello& hello = outbox_->hello();
  if (submap.key.agent != hello.agent || submap.key.session != hello.session) {
    return absl::InvalidArgumentError("submap belongs to another session");
  }
  PORTOLAN_ASSIGN_OR_RETURN(const std::string bytes, EncodeSubmap(submap));
  PORTOLAN_RETURN_IF_ERROR(outbox_->Append(submap.key.sequence_number, bytes));
  std::unique_lock lock(mutex_);
  news_ = true;
  changed_.notify_all();
  return absl::OkStatus();
}

void UplinkSession::SetLivePose(const LivePose& pose) {
  std::unique_lock lock(mutex_);
  protocol_.SetLivePose(pose);
  news_ = true;
  changed_.notify_all();
}

Status UplinkSession::Finish(Duration timeout) {
  std::unique_lock lock(mutex_);
  protocol_.RequestFinish();
  news_ = true;
  changed_.notify_all();
  clock_->WaitUntil(&lock, &changed_, clock_->Now() + std::min(timeout, kLongestWait),
                    [this] { return protocol_.finished() || shutdown_; });
  if (protocol_.finished()) {
    outbox_->RemoveIfDone();
    return absl::OkStatus();
  }
  if (shutdown_) return absl::CancelledError("the uplink was shut down");
  return absl::DeadlineExceededError(
      absl::StrCat(outbox_->pending_count(), " submaps are not acknowledged; last error: ",
                   protocol_.stats().last_error.empty() ? "none" : protocol_.stats().last_error));
}

void UplinkSession::Shutdown() {
  {
    std::unique_lock lock(mutex_);
    shutdown_ = true;
    if (context_ != nullptr) context_->TryCancel();
    changed_.notify_all();
  }
  if (thread_.joinable()) thread_.join();
}

UplinkStats UplinkSession::stats() const {
  std::unique_lock lock(mutex_);
  return protocol_.stats();
}

void UplinkSession::Run() {
  for (;;) {
    backoff_.AttemptStarted();
    const uint64_t accepted_before = stats().accepted_submaps;
    const Status status = RunStream();
    std::unique_lock lock(mutex_);
    protocol_.StreamEnded(status);
    changed_.notify_all();
    if (shutdown_ || protocol_.finished()) return;
    if (protocol_.stats().accepted_submaps > accepted_before) backoff_.Reset();
    const bool stop =
        clock_->WaitUntil(&lock, &changed_, backoff_.AttemptFailed(), [this] { return shutdown_; });
    if (stop) return;
  }
}

Status UplinkSession::RunStream() {
  Stream stream;
  const auto stub = v1::AgentService::NewStub(CreateChannel(options_));
  v1::AgentMessage hello;
  {
    std::unique_lock lock(mutex_);
    if (shutdown_) return absl::CancelledError("shutdown");
    context_ = &stream.context;
    hello = protocol_.StartStream();
  }
  stream.rpc = stub->Connect(&stream.context);
  std::thread reader([this, &stream] { ReadAll(&stream); });
  if (stream.rpc->Write(hello)) WriteAll(&stream);
  // The stream ends by itself: the server has ended it, or the link is broken, or Shutdown has
  // cancelled it, or the server ends it after Finished.
  stream.rpc->WritesDone();
  reader.join();
  const grpc::Status status = stream.rpc->Finish();
  std::unique_lock lock(mutex_);
  context_ = nullptr;
  return FromGrpc(status);
}

void UplinkSession::ReadAll(Stream* stream) {
  v1::ServerMessage message;
  while (stream->rpc->Read(&message)) {
    std::optional<MapCorrection> correction;
    {
      std::unique_lock lock(mutex_);
      correction = protocol_.OnMessage(message);
      news_ = true;
      changed_.notify_all();
    }
    if (correction.has_value() && on_correction_) on_correction_(*correction);
  }
  std::unique_lock lock(mutex_);
  stream->ended = true;
  changed_.notify_all();
}

bool UplinkSession::MustWake(const Stream& stream) const {
  return news_ || stream.ended || shutdown_ || protocol_.finished();
}

void UplinkSession::WriteAll(Stream* stream) {
  for (;;) {
    std::optional<v1::AgentMessage> message;
    {
      std::unique_lock lock(mutex_);
      if (stream->ended || shutdown_ || protocol_.finished()) return;
      news_ = false;
      message = protocol_.Next(clock_->Now());
      if (!message.has_value()) {
        const Duration due = protocol_.NextDue().value_or(clock_->Now() + std::chrono::hours(1));
        clock_->WaitUntil(&lock, &changed_, due, [&] { return MustWake(*stream); });
        continue;
      }
    }
    if (!stream->rpc->Write(*message)) return;
  }
}

}  // namespace portolan
