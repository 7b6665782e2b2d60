// Time for threads that wait: injected, so that tests decide how fast it runs.
#ifndef PORTOLAN_COMMON_CONCURRENCY_CLOCK_H_
#define PORTOLAN_COMMON_CONCURRENCY_CLOCK_H_

#include <atomic>
#include <condition_variable>
#include <functional>
#include <mutex>

#include "common/base/time.h"

namespace portolan {

// Monotonic time since an arbitrary start; not the sensors' clock. Thread-safe.
class Clock {
 public:
  virtual ~Clock() = default;

  virtual Duration Now() const = 0;

  // Waits on `changed`, whose mutex `lock` holds, until condition() or until Now() >= deadline.
  // Returns condition(). Whoever makes the condition true notifies `changed`.
  virtual bool WaitUntil(std::unique_lock<std::mutex>* lock, std::condition_variable* changed,
                         Duration deadline, const std::function<bool()>& condition) = 0;
};

class SteadyClock : public Clock {
 public:
  // One for all.
  static SteadyClock* Get();

  Duration Now() const override;
  bool WaitUntil(std::unique_lock<std::mutex>* lock, std::condition_variable* changed,
                 Duration deadline, const std::function<bool()>& condition) override;
};

// Stands still until told to advance. Waiting threads notice an advance within a millisecond of
// real time.
class FakeClock : public Clock {
 public:
  void Advance(Duration duration) { now_ns_ += duration.count(); }
  // Threads that are inside WaitUntil now.
  int waiting() const { return waiting_; }

  Duration Now() const override { return Duration(now_ns_); }
  bool WaitUntil(std::unique_lock<std::mutex>* lock, std::condition_variable* changed,
                 Duration deadline, const std::function<bool()>& condition) override;

 private:
  std::atomic<int64_t> now_ns_{0};
  std::atomic<int> waiting_{0};
};

}  // namespace portolan

#endif  // PORTOLAN_COMMON_CONCURRENCY_CLOCK_H_
