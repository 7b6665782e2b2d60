// A queue between two stages that never grows beyond its capacity.
#ifndef PORTOLAN_COMMON_CONCURRENCY_BOUNDED_QUEUE_H_
#define PORTOLAN_COMMON_CONCURRENCY_BOUNDED_QUEUE_H_

#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <mutex>
#include <optional>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "common/base/check.h"

namespace portolan {

// What Push does when the queue is full.
enum class WhenFull {
  kBlock,       // waits for room
  kDropOldest,  // makes room by dropping the oldest item
  kReject,      // drops the new item
};

enum class PushResult {
  kQueued,
  kQueuedAfterDrop,  // the oldest item made room
  kRejected,         // full, and the policy is kReject
  kClosed,
};

// Thread-safe, any number of producers and consumers. Items leave in the order of arrival.
template <typename T>
class BoundedQueue {
 public:
  BoundedQueue(size_t capacity, WhenFull when_full) : capacity_(capacity), when_full_(when_full) {
    PORTOLAN_CHECK(capacity > 0);
  }

  PushResult Push(T item) {
    std::unique_lock lock(mutex_);
    if (when_full_ == WhenFull::kBlock) {
      has_room_.wait(lock, [this] { return closed_ || items_.size() < capacity_; });
    }
    if (closed_) return PushResult::kClosed;
    PushResult result = PushResult::kQueued;
    if (items_.size() >= capacity_) {
      ++dropped_;
      if (when_full_ == WhenFull::kReject) return PushResult::kRejected;
      items_.pop_front();
      result = PushResult::kQueuedAfterDrop;
    }
    items_.push_back(std::move(item));
    has_items_.notify_one();
    return result;
  }

  // Waits for an item; no value once the queue is closed and empty.
  std::optional<T> Pop() {
    std::unique_lock lock(mutex_);
    has_items_.wait(lock, [this] { return closed_ || !items_.empty(); });
    return TakeFront();
  }

  std::optional<T> TryPop() {
    std::unique_lock lock(mutex_);
    return TakeFront();
  }

  // Push fails from now on, Pop drains what is left. Wakes everyone. May be called again.
  void Close() {
    std::unique_lock lock(mutex_);
    closed_ = true;
    has_items_.notify_all();
    has_room_.notify_all();
  }

  size_t size() const {
    std::unique_lock lock(mutex_);
    return items_.size();
  }
  // Items that were dropped or rejected because the queue was full.
  uint64_t dropped() const {
    std::unique_lock lock(mutex_);
    return dropped_;
  }

 private:
  std::optional<T> TakeFront() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (items_.empty()) return std::nullopt;
    std::optional<T> item(std::move(items_.front()));
    items_.pop_front();
    has_room_.notify_one();
    return item;
  }

  const size_t capacity_;
  const WhenFull when_full_;
  mutable std::mutex mutex_;
  std::condition_variable has_items_;
  std::condition_variable has_room_;
  std::deque<T> items_ ABSL_GUARDED_BY(mutex_);
  uint64_t dropped_ ABSL_GUARDED_BY(mutex_) = 0;
  bool closed_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace portolan

#endif  // PORTOLAN_COMMON_CONCURRENCY_BOUNDED_QUEUE_H_
