#include "server/rpc/follow_changes.h"

#include <utility>

#include "server/rpc/map_handlers.h"

namespace portolan {
namespace {

constexpr int kMaxSubmapsOfMessage = 256;

}  // namespace

grpc::ServerWriteReactor<v1::MapChange>* FollowChangesStream::Start(
    const ServerContext& server, const v1::FollowChangesRequest& request) {
  std::shared_ptr<FollowChangesStream> stream(
      new FollowChangesStream(server, request.since_version()));
  stream->self_ = stream;
  stream->subscription_ = server.hub->Subscribe([weak = std::weak_ptr(stream)] {
    if (const auto stream = weak.lock()) stream->Advance();
  });
  stream->Advance();
  return stream.get();
}

bool FollowChangesStream::MakeChange() {
  if (!telling_) {
    std::shared_ptr<const MapSnapshot> newest = server_.hub->Get();
    // A version from the future belongs to another life of the map: tell everything.
    if (told_version_ > newest->version) told_version_ = 0;
    if (told_version_ == newest->version) return false;
    telling_ = std::move(newest);
    next_submap_ = 0;
  }
  change_.Clear();
  change_.set_map_version(telling_->version);
  for (; next_submap_ < telling_->submaps.size(); ++next_submap_) {
    const SubmapState& state = *telling_->submaps[next_submap_];
    if (state.moved_at_version <= told_version_) continue;
    if (change_.submaps_size() == kMaxSubmapsOfMessage) {
      change_.set_more(true);
      return true;
    }
    FillSubmapInfo(state, *server_.sessions, change_.add_submaps());
  }
  told_version_ = telling_->version;
  telling_.reset();
  return true;
}

void FollowChangesStream::Advance() {
  bool must_write = false, must_finish = false;
  {
    const std::lock_guard lock(mutex_);
    if (is_writing_ || is_finished_) return;
    if (is_cancelled_) {
      is_finished_ = must_finish = true;
    } else {
      is_writing_ = must_write = MakeChange();
    }
  }
  // Outside of the lock, as gRPC may call back on this thread.
  if (must_write) StartWrite(&change_);
  if (must_finish) Finish(grpc::Status::CANCELLED);
}

void FollowChangesStream::OnWriteDone(bool ok) {
  {
    const std::lock_guard lock(mutex_);
    is_writing_ = false;
    is_cancelled_ |= !ok;
  }
  Advance();
}

void FollowChangesStream::OnCancel() {
  {
    const std::lock_guard lock(mutex_);
    is_cancelled_ = true;
  }
  Advance();
}

void FollowChangesStream::OnDone() {
  server_.hub->Unsubscribe(subscription_);
  // May destroy this.
  std::exchange(self_, nullptr).reset();
}

}  // namespace portolan
