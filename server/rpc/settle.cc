#include "server/rpc/settle.h"

#include <utility>

namespace portolan {

grpc::ServerUnaryReactor* SettleCall::Start(const ServerContext& server,
                                            v1::SettleResponse* response) {
  std::shared_ptr<SettleCall> call(new SettleCall(response));
  call->self_ = call;
  server.map_thread->WhenSettled([weak = std::weak_ptr(call)](uint64_t map_version) {
    const auto call = weak.lock();
    if (!call || call->is_over_.exchange(true)) return;
    call->response_->set_map_version(map_version);
    call->Finish(grpc::Status::OK);
  });
  return call.get();
}

void SettleCall::OnCancel() {
  if (!is_over_.exchange(true)) Finish(grpc::Status::CANCELLED);
}

void SettleCall::OnDone() { std::exchange(self_, nullptr).reset(); }

}  // namespace portolan
