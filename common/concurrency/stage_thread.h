// One thread that works through a bounded queue, an item at a time.
#ifndef PORTOLAN_COMMON_CONCURRENCY_STAGE_THREAD_H_
#define PORTOLAN_COMMON_CONCURRENCY_STAGE_THREAD_H_

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <thread>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "common/concurrency/bounded_queue.h"

namespace portolan {

// Calls `work` on its own thread for each item in the order of arrival, without holding a lock.
// `work` must not throw and must not call WaitUntilIdle or Shutdown of its own stage.
//
//   StageThread<Job> stage(16, WhenFull::kBlock, [&](Job job) { ... });
//   stage.Start();  stage.Push(job);  stage.WaitUntilIdle();  stage.Shutdown();
//
// Thread-safe, except that Start is called once, before Shutdown. The destructor shuts down.
template <typename T>
class StageThread {
 public:
  StageThread(size_t capacity, WhenFull when_full, std::function<void(T)> work)
      : queue_(capacity, when_full), work_(std::move(work)) {}
  ~StageThread() { Shutdown(); }
  StageThread(const StageThread&) = delete;
  StageThread& operator=(const StageThread&) = delete;

  void Start() {
    std::unique_lock lock(mutex_);
    PORTOLAN_CHECK(!thread_.joinable());
    thread_ = std::thread([this] { Run(); });
  }

  // Items pushed before Start wait for it.
  PushResult Push(T item) {
    {
      // Counted before it is queued, so that WaitUntilIdle cannot miss it.
      std::unique_lock lock(mutex_);
      ++pending_;
    }
    const PushResult result = queue_.Push(std::move(item));
    if (result != PushResult::kQueued) MarkDone();  // it, or the one it replaced, never runs
    return result;
  }

  // Returns when every item pushed before the call is done (or dropped), or after Shutdown.
  void WaitUntilIdle() {
    std::unique_lock lock(mutex_);
    idle_.wait(lock, [this] { return pending_ == 0 || stopped_; });
  }

  // Finishes the item under way, forgets the queued ones, joins the thread. May be called again.
  void Shutdown() {
    std::thread thread;
    {
      std::unique_lock lock(mutex_);
      stopped_ = true;
      idle_.notify_all();
      thread = std::move(thread_);
    }
    queue_.Close();
    if (thread.joinable()) thread.join();
  }

  size_t queued() const { return queue_.size(); }
  uint64_t dropped() const { return queue_.dropped(); }

 private:
  void Run() {
    while (auto item = queue_.Pop()) {
      {
        std::unique_lock lock(mutex_);
        if (stopped_) return;
      }
      work_(*std::move(item));
      MarkDone();
    }
  }

  void MarkDone() {
    std::unique_lock lock(mutex_);
    if (--pending_ == 0) idle_.notify_all();
  }

  BoundedQueue<T> queue_;
  const std::function<void(T)> work_;
  std::mutex mutex_;
  std::condition_variable idle_;
  int64_t pending_ ABSL_GUARDED_BY(mutex_) = 0;
  bool stopped_ ABSL_GUARDED_BY(mutex_) = false;
  std::thread thread_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace portolan

#endif  // PORTOLAN_COMMON_CONCURRENCY_STAGE_THREAD_H_
