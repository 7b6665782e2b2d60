// One agent's stream: reads its messages one at a time and writes acknowledgements and corrections.
#ifndef PORTOLAN_SERVER_RPC_AGENT_STREAM_H_
#define PORTOLAN_SERVER_RPC_AGENT_STREAM_H_

#include <grpcpp/grpcpp.h>

#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <utility>

#include "proto/agent_service.pb.h"
#include "server/rpc/server_context.h"

namespace portolan {

class AgentStreams;

// Thread-safe. Protocol: proto/README.md. The next message is read after the last one was dealt
// with, a submap after its verdict: what the agent sends faster waits in HTTP/2's flow control.
// Keeps itself alive until gRPC is done with it.
//
// gRPC forbids operations after Finish and may call back on the thread that starts one. So an
// operation is announced under the lock (is_writing_, starting_), started outside of it, and Finish
// waits until none is announced.
class AgentStream : public grpc::ServerBidiReactor<v1::AgentMessage, v1::ServerMessage>,
                    public CorrectionSink,
                    public std::enable_shared_from_this<AgentStream> {
 public:
  static std::shared_ptr<AgentStream> Start(const ServerContext& server,
                                            std::shared_ptr<AgentStreams> streams,
                                            grpc::CallbackServerContext* call);

  // Ends the stream with this status after what is queued was written.
  void End(const Status& status);

  void OnReadDone(bool ok) override;
  void OnWriteDone(bool ok) override;
  void OnCancel() override;
  void OnDone() override;

  bool IsReady() const override;
  void Send(const MapCorrection& correction) override;
  std::optional<LivePose> NewestPose() const override;

 private:
  AgentStream(const ServerContext& server, std::shared_ptr<AgentStreams> streams,
              grpc::CallbackServerContext* call)
      : server_(server), streams_(std::move(streams)), call_(call) {}

  void Handle(const v1::AgentMessage& message);
  void HandleHello(const v1::Hello& message);
  void HandleSubmap(const v1::SubmapUpload& message);
  void HandleLivePose(const v1::LivePose& message);
  void HandleFinish();
  // The map may settle: waits for it, then for the last corrections, then says Finished.
  void FinishWhenSettled();

  void Read();
  void Write(v1::ServerMessage message);
  // Ends the stream of an agent that does not read: what is queued cannot be written before the
  // end.
  void Cancel();
  // Starts the next write or Finish, if it is time.
  void Advance();

  const ServerContext server_;
  const std::shared_ptr<AgentStreams> streams_;
  grpc::CallbackServerContext* const call_;  // lives until OnDone
  std::shared_ptr<AgentStream> self_;
  // Set by Hello, on the thread of the read; read later by the same chain of reads.
  std::optional<SessionName> session_;
  // That the agent speaks; set by Hello before corrections are asked for.
  uint32_t protocol_version_ = 0;
  // Set by Finish, likewise: the end of the agent's messages is no reason to end the stream.
  bool finish_requested_ = false;

  v1::AgentMessage incoming_;  // not touched while it is read

  mutable std::mutex mutex_;
  // Guarded by mutex_.
  std::deque<v1::ServerMessage> outgoing_;  // the front is being written if is_writing_
  int corrections_outgoing_ = 0;
  bool is_writing_ = false;
  int starting_ = 0;         // reads, and a cancellation
  bool has_failed_ = false;  // nothing more can be written: the peer is gone or does not read
  std::optional<Status> end_;
  bool is_finished_ = false;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_RPC_AGENT_STREAM_H_
