// A map server reduced to the agent's stream, in this process, with faults on demand.
#ifndef PORTOLAN_TESTS_AGENT_UPLINK_FAKE_SERVER_H_
#define PORTOLAN_TESTS_AGENT_UPLINK_FAKE_SERVER_H_

#include <condition_variable>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "grpcpp/grpcpp.h"
#include "proto/agent_service.grpc.pb.h"

namespace portolan {

// What the server's state survives when FakeServer objects come and go.
struct FakeMap {
  std::mutex mutex;
  std::condition_variable changed;
  // By sequence number: the bytes of the first upload, and how often it came.
  std::map<uint32_t, std::string> submaps;
  std::map<uint32_t, int> uploads;
  std::vector<uint32_t> order;  // of all uploads
  std::vector<v1::Hello> hellos;
  std::vector<v1::LivePose> live_poses;

  // Waits for a state; false after 20 s.
  bool Await(const std::function<bool()>& condition);
};

using ServerStream = grpc::ServerReaderWriter<v1::ServerMessage, v1::AgentMessage>;

// Serves on an ephemeral port of 127.0.0.1, or on `port` if given.
class FakeServer : public v1::AgentService::Service {
 public:
  struct Faults {
    // Ends the stream without an answer after so many uploads on it; 0 for never.
    int die_after_uploads = 0;
    // Every acknowledgement comes twice.
    bool duplicate_acks = false;
    // Acknowledgements are held back and sent in reverse in groups of so many.
    size_t reverse_acks = 1;
    // Sent right after Welcome.
    std::vector<v1::ServerMessage> after_welcome = {};
    // Sent before Welcome.
    std::vector<v1::ServerMessage> before_welcome = {};
    // Refused with REJECTED.
    std::set<uint32_t> rejected = {};
    // Ends the stream with INVALID_ARGUMENT at this upload.
    std::set<uint32_t> poison = {};
    // Claims this in Welcome instead of the truth.
    std::optional<uint32_t> welcome_next = std::nullopt;
    // Never acknowledges.
    bool mute = false;
  };

  FakeServer(FakeMap* map, Faults faults, int port = 0);
  ~FakeServer() override;

  std::string address() const;
  int port() const { return port_; }

  grpc::Status Connect(grpc::ServerContext* context, ServerStream* stream) override;

 private:
  // False ends the stream.
  bool OnUpload(const v1::SubmapUpload& upload, ServerStream* stream, int uploads);
  void FlushAcks(ServerStream* stream);
  v1::ServerMessage Welcome();

  FakeMap* const map_;
  const Faults faults_;
  int port_ = 0;
  std::vector<v1::ServerMessage> held_acks_;
  std::unique_ptr<grpc::Server> server_;
};

}  // namespace portolan

#endif  // PORTOLAN_TESTS_AGENT_UPLINK_FAKE_SERVER_H_
