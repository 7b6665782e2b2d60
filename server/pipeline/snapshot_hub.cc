#include "server/pipeline/snapshot_hub.h"

#include <utility>
#include <vector>

namespace portolan {

SnapshotHub::SnapshotHub() {
  auto empty = std::make_shared<MapSnapshot>();
  empty->closures = std::make_shared<const ClosureList>();
  snapshot_ = std::move(empty);
}

std::shared_ptr<const MapSnapshot> SnapshotHub::Get() const {
  const std::lock_guard lock(mutex_);
  return snapshot_;
}

void SnapshotHub::Publish(std::shared_ptr<const MapSnapshot> snapshot) {
  std::vector<std::shared_ptr<const std::function<void()>>> subscribers;
  {
    const std::lock_guard lock(mutex_);
    snapshot_ = std::move(snapshot);
    for (const auto& [id, function] : subscribers_) subscribers.push_back(function);
  }
  for (const auto& function : subscribers) (*function)();
}

uint64_t SnapshotHub::Subscribe(std::function<void()> on_publish) {
  const std::lock_guard lock(mutex_);
  subscribers_[next_subscription_] =
      std::make_shared<const std::function<void()>>(std::move(on_publish));
  return next_subscription_++;
}

void SnapshotHub::Unsubscribe(uint64_t subscription) {
  const std::lock_guard lock(mutex_);
  subscribers_.erase(subscription);
}

}  // namespace portolan
