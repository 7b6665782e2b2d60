// Status of the project to gRPC's, whose codes are the same numbers.
#ifndef PORTOLAN_SERVER_RPC_GRPC_STATUS_H_
#define PORTOLAN_SERVER_RPC_GRPC_STATUS_H_

#include <grpcpp/support/status.h>

#include <string>

#include "common/base/status.h"

namespace portolan {

inline grpc::Status ToGrpc(const Status& status) {
  return {static_cast<grpc::StatusCode>(status.code()), std::string(status.message())};
}

}  // namespace portolan

#endif  // PORTOLAN_SERVER_RPC_GRPC_STATUS_H_
