// The stream of a caller that follows the map's versions.
#ifndef PORTOLAN_SERVER_RPC_FOLLOW_CHANGES_H_
#define PORTOLAN_SERVER_RPC_FOLLOW_CHANGES_H_

#include <grpcpp/grpcpp.h>

#include <cstdint>
#include <memory>
#include <mutex>

#include "proto/map_service.pb.h"
#include "server/rpc/server_context.h"

namespace portolan {

// Writes one MapChange after the other, each from the version told before to the newest one, so
// that a slow caller skips versions but no change. Keeps itself alive until gRPC is done with it.
class FollowChangesStream : public grpc::ServerWriteReactor<v1::MapChange>,
                            public std::enable_shared_from_this<FollowChangesStream> {
 public:
  static grpc::ServerWriteReactor<v1::MapChange>* Start(const ServerContext& server,
                                                        const v1::FollowChangesRequest& request);

  void OnWriteDone(bool ok) override;
  void OnCancel() override;
  void OnDone() override;

 private:
  FollowChangesStream(const ServerContext& server, uint64_t since_version)
      : server_(server), told_version_(since_version) {}

  // Writes the next message, or finishes, or waits.
  void Advance();
  // Fills change_ with the next message; false: nothing to tell. Holds mutex_.
  bool MakeChange();

  const ServerContext server_;
  uint64_t subscription_ = 0;
  std::shared_ptr<FollowChangesStream> self_;

  std::mutex mutex_;
  // Guarded by mutex_.
  uint64_t told_version_;
  // The version that is being told and the position in it; null between versions.
  std::shared_ptr<const MapSnapshot> telling_;
  size_t next_submap_ = 0;
  bool is_writing_ = false;
  bool is_cancelled_ = false;
  bool is_finished_ = false;

  v1::MapChange change_;  // not touched while it is written
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_RPC_FOLLOW_CHANGES_H_
