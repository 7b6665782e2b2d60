// An agent's side of the stream for tests: plain blocking calls.
#ifndef PORTOLAN_TESTS_SERVER_SUPPORT_AGENT_CONNECTION_H_
#define PORTOLAN_TESTS_SERVER_SUPPORT_AGENT_CONNECTION_H_

#include <grpcpp/grpcpp.h>

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/wire/agent_wire.h"
#include "proto/agent_service.grpc.pb.h"

namespace portolan::testing {

// Thread-compatible. Corrections that arrive while something else is awaited are kept.
class AgentConnection {
 public:
  explicit AgentConnection(const std::string& address);
  ~AgentConnection();

  // Says hello; no value if the server ends the stream instead (see status()).
  std::optional<v1::Welcome> Hello(const SessionHello& hello);
  bool Send(const v1::AgentMessage& message);
  bool SendUpload(const v1::SubmapUpload& upload);
  std::optional<v1::SubmapAck> WaitForAck();
  // The first correction not yet taken.
  std::optional<v1::Correction> WaitForCorrection();
  // Sends Finish and waits.
  std::optional<v1::Finished> Finish();
  // Corrections that came so far and were not taken.
  const std::vector<v1::Correction>& corrections() const { return corrections_; }
  // Ends the stream without a word, as a lost network does.
  void Drop();
  // Closes our side, reads what is left, and returns how the server ended the stream.
  grpc::Status status();

 private:
  // Reads until a message satisfies; corrections on the way are kept.
  bool ReadUntil(const std::function<bool(const v1::ServerMessage&)>& is_wanted,
                 v1::ServerMessage* message);

  grpc::ClientContext context_;
  std::unique_ptr<v1::AgentService::Stub> stub_;
  std::unique_ptr<grpc::ClientReaderWriter<v1::AgentMessage, v1::ServerMessage>> stream_;
  std::vector<v1::Correction> corrections_;
  bool is_over_ = false;
};

}  // namespace portolan::testing

#endif  // PORTOLAN_TESTS_SERVER_SUPPORT_AGENT_CONNECTION_H_
