#include "tests/agent/uplink/fake_server.h"

#include <algorithm>
#include <chrono>

#include "common/wire/agent_wire.h"

namespace portolan {

bool FakeMap::Await(const std::function<bool()>& condition) {
  std::unique_lock lock(mutex);
  return changed.wait_for(lock, std::chrono::seconds(20), condition);
}

FakeServer::FakeServer(FakeMap* map, Faults faults, int port)
    : map_(map), faults_(std::move(faults)) {
  grpc::ServerBuilder builder;
  builder.AddListeningPort("127.0.0.1:" + std::to_string(port), grpc::InsecureServerCredentials(),
                           &port_);
  builder.RegisterService(this);
  server_ = builder.BuildAndStart();
}

FakeServer::~FakeServer() {
  server_->Shutdown(std::chrono::system_clock::now());  // at once; streams break
}

std::string FakeServer::address() const { return "127.0.0.1:" + std::to_string(port_); }

v1::ServerMessage FakeServer::Welcome() {
  v1::ServerMessage message;
  std::unique_lock lock(map_->mutex);
  const uint32_t next = map_->submaps.empty() ? 0 : map_->submaps.rbegin()->first + 1;
  message.mutable_welcome()->set_next_sequence_number(faults_.welcome_next.value_or(next));
  return message;
}

grpc::Status FakeServer::Connect(grpc::ServerContext*, ServerStream* stream) {
  v1::AgentMessage message;
  int uploads = 0;
  held_acks_.clear();
  while (stream->Read(&message)) {
    if (message.has_hello()) {
      for (const auto& m : faults_.before_welcome) stream->Write(m);
      stream->Write(Welcome());
      for (const auto& m : faults_.after_welcome) stream->Write(m);
      std::unique_lock lock(map_->mutex);
      map_->hellos.push_back(message.hello());
    } else if (message.has_submap()) {
      if (faults_.poison.count(message.submap().sequence_number()) > 0) {
        return {grpc::StatusCode::INVALID_ARGUMENT, "poison"};
      }
      if (!OnUpload(message.submap(), stream, ++uploads)) {
        return {grpc::StatusCode::UNAVAILABLE, "killed"};
      }
    } else if (message.has_live_pose()) {
      std::unique_lock lock(map_->mutex);
      map_->live_poses.push_back(message.live_pose());
    } else if (message.has_finish()) {
      FlushAcks(stream);
      v1::ServerMessage finished;
      finished.mutable_finished()->set_map_version(99);
      stream->Write(finished);
      return grpc::Status::OK;
    }
    map_->changed.notify_all();
  }
  return grpc::Status::OK;
}

bool FakeServer::OnUpload(const v1::SubmapUpload& upload, ServerStream* stream, int uploads) {
  const bool rejected =
      faults_.rejected.count(upload.sequence_number()) > 0 || !CheckUpload(upload).ok();
  {
    std::unique_lock lock(map_->mutex);
    map_->order.push_back(upload.sequence_number());
    ++map_->uploads[upload.sequence_number()];
    if (!rejected) map_->submaps.emplace(upload.sequence_number(), upload.submap());
  }
  if (faults_.die_after_uploads > 0 && uploads >= faults_.die_after_uploads) return false;
  v1::ServerMessage ack;
  ack.mutable_ack()->set_sequence_number(upload.sequence_number());
  ack.mutable_ack()->set_verdict(rejected ? v1::SUBMAP_VERDICT_REJECTED
                                          : v1::SUBMAP_VERDICT_ACCEPTED);
  if (rejected) ack.mutable_ack()->set_reason("implausible");
  if (!faults_.mute) held_acks_.push_back(ack);
  if (held_acks_.size() >= faults_.reverse_acks) FlushAcks(stream);
  return true;
}

void FakeServer::FlushAcks(ServerStream* stream) {
  std::reverse(held_acks_.begin(), held_acks_.end());
  for (const auto& ack : held_acks_) {
    stream->Write(ack);
    if (faults_.duplicate_acks) stream->Write(ack);
  }
  held_acks_.clear();
}

}  // namespace portolan
