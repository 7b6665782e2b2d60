// Holds the newest version of the map and tells those who wait for a newer one.
#ifndef PORTOLAN_SERVER_PIPELINE_SNAPSHOT_HUB_H_
#define PORTOLAN_SERVER_PIPELINE_SNAPSHOT_HUB_H_

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>

#include "server/fusion/map_state.h"

namespace portolan {

// Thread-safe.
class SnapshotHub {
 public:
  SnapshotHub();

  // Never null; an empty map of version 0 before the first Publish.
  std::shared_ptr<const MapSnapshot> Get() const;

  // Replaces the map, then calls every subscriber on this thread, without a lock.
  void Publish(std::shared_ptr<const MapSnapshot> snapshot);

  // A call may still be under way when Unsubscribe returns: the function must own what it uses
  // (by weak_ptr or the like) and return quickly.
  uint64_t Subscribe(std::function<void()> on_publish);
  void Unsubscribe(uint64_t subscription);

 private:
  mutable std::mutex mutex_;
  // Guarded by mutex_.
  std::shared_ptr<const MapSnapshot> snapshot_;
  std::map<uint64_t, std::shared_ptr<const std::function<void()>>> subscribers_;
  uint64_t next_subscription_ = 1;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_PIPELINE_SNAPSHOT_HUB_H_
