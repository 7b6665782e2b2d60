#include "server/rpc/agent_service.h"

#include "server/rpc/agent_stream.h"

namespace portolan {
namespace {

// Refuses a stream. Owned by gRPC.
class RefusedStream : public grpc::ServerBidiReactor<v1::AgentMessage, v1::ServerMessage> {
 public:
  RefusedStream() { Finish({grpc::StatusCode::RESOURCE_EXHAUSTED, "too many agents"}); }
  void OnDone() override { delete this; }
};

}  // namespace

grpc::ServerBidiReactor<v1::AgentMessage, v1::ServerMessage>* AgentServiceImpl::Connect(
    grpc::CallbackServerContext* context) {
  if (!streams_->Admit()) return new RefusedStream();
  return AgentStream::Start(server_, streams_, context).get();
}

}  // namespace portolan
