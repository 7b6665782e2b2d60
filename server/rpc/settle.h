// The call of one who waits for the map to settle.
#ifndef PORTOLAN_SERVER_RPC_SETTLE_H_
#define PORTOLAN_SERVER_RPC_SETTLE_H_

#include <grpcpp/grpcpp.h>

#include <atomic>
#include <memory>

#include "proto/map_service.pb.h"
#include "server/rpc/server_context.h"

namespace portolan {

// Ends when the map thread has settled, or when the caller gives up. Keeps itself alive until
// gRPC is done with it.
class SettleCall : public grpc::ServerUnaryReactor {
 public:
  static grpc::ServerUnaryReactor* Start(const ServerContext& server, v1::SettleResponse* response);

  void OnCancel() override;
  void OnDone() override;

 private:
  explicit SettleCall(v1::SettleResponse* response) : response_(response) {}

  v1::SettleResponse* const response_;
  std::atomic<bool> is_over_ = false;
  std::shared_ptr<SettleCall> self_;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_RPC_SETTLE_H_
