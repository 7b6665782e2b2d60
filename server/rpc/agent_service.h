// AgentService on gRPC's callback interface.
#ifndef PORTOLAN_SERVER_RPC_AGENT_SERVICE_H_
#define PORTOLAN_SERVER_RPC_AGENT_SERVICE_H_

#include <grpcpp/grpcpp.h>

#include <memory>

#include "proto/agent_service.grpc.pb.h"
#include "server/rpc/agent_streams.h"
#include "server/rpc/server_context.h"

namespace portolan {

// Thread-safe. Streams take no thread each: gRPC's few callback threads serve all.
class AgentServiceImpl : public v1::AgentService::CallbackService {
 public:
  explicit AgentServiceImpl(const ServerContext& server)
      : server_(server),
        streams_(std::make_shared<AgentStreams>(server.max_agents, server.sessions)) {}

  grpc::ServerBidiReactor<v1::AgentMessage, v1::ServerMessage>* Connect(
      grpc::CallbackServerContext* context) override;

  // Tells every agent that the server stops.
  void EndAll() { streams_->EndAll(absl::UnavailableError("the server stops")); }

 private:
  const ServerContext server_;
  const std::shared_ptr<AgentStreams> streams_;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_RPC_AGENT_SERVICE_H_
