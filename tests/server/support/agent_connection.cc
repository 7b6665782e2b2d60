#include "tests/server/support/agent_connection.h"

#include <utility>

namespace portolan::testing {

AgentConnection::AgentConnection(const std::string& address) {
  grpc::ChannelArguments arguments;
  // Each connection of its own, as those of different agents are.
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  // What is not read fills 64 kB and no more, however fast the machine is.
  arguments.SetInt(GRPC_ARG_HTTP2_BDP_PROBE, 0);
  stub_ = v1::AgentService::NewStub(
      grpc::CreateCustomChannel(address, grpc::InsecureChannelCredentials(), arguments));
  stream_ = stub_->Connect(&context_);
}

AgentConnection::~AgentConnection() { Drop(); }

bool AgentConnection::ReadUntil(const std::function<bool(const v1::ServerMessage&)>& is_wanted,
                                v1::ServerMessage* message) {
  while (stream_->Read(message)) {
    if (message->has_correction()) corrections_.push_back(message->correction());
    if (is_wanted(*message)) return true;
  }
  return false;
}

bool AgentConnection::Send(const v1::AgentMessage& message) { return stream_->Write(message); }

std::optional<v1::Welcome> AgentConnection::Hello(const SessionHello& hello) {
  v1::AgentMessage message;
  ToProto(hello, message.mutable_hello());
  Send(message);
  v1::ServerMessage answer;
  if (!ReadUntil([](const auto& m) { return m.has_welcome(); }, &answer)) return std::nullopt;
  return answer.welcome();
}

bool AgentConnection::SendUpload(const v1::SubmapUpload& upload) {
  v1::AgentMessage message;
  *message.mutable_submap() = upload;
  return Send(message);
}

std::optional<v1::SubmapAck> AgentConnection::WaitForAck() {
  v1::ServerMessage answer;
  if (!ReadUntil([](const auto& m) { return m.has_ack(); }, &answer)) return std::nullopt;
  return answer.ack();
}

std::optional<v1::Correction> AgentConnection::WaitForCorrection() {
  v1::ServerMessage answer;
  if (corrections_.empty() &&
      !ReadUntil([](const auto& m) { return m.has_correction(); }, &answer)) {
    return std::nullopt;
  }
  v1::Correction first = std::move(corrections_.front());
  corrections_.erase(corrections_.begin());
  return first;
}

std::optional<v1::Finished> AgentConnection::Finish() {
  v1::AgentMessage message;
  message.mutable_finish();
  Send(message);
  v1::ServerMessage answer;
  if (!ReadUntil([](const auto& m) { return m.has_finished(); }, &answer)) return std::nullopt;
  return answer.finished();
}

void AgentConnection::Drop() {
  if (std::exchange(is_over_, true)) return;
  context_.TryCancel();
  stream_->Finish();
}

grpc::Status AgentConnection::status() {
  if (std::exchange(is_over_, true)) return grpc::Status::CANCELLED;
  stream_->WritesDone();
  v1::ServerMessage ignored;
  while (stream_->Read(&ignored)) {
  }
  return stream_->Finish();
}

}  // namespace portolan::testing
