// Counters, gauges and timers that a program shows to its operator. Cheap enough for every frame.
#ifndef PORTOLAN_COMMON_METRICS_METRICS_H_
#define PORTOLAN_COMMON_METRICS_METRICS_H_

#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <string>

#include "absl/base/thread_annotations.h"
#include "common/base/time.h"

namespace portolan {

// Only grows. Thread-safe.
class Counter {
 public:
  void Add(uint64_t amount = 1) { value_.fetch_add(amount, std::memory_order_relaxed); }
  uint64_t value() const { return value_.load(std::memory_order_relaxed); }

 private:
  std::atomic<uint64_t> value_{0};
};

// The last value set. Thread-safe.
class Gauge {
 public:
  void Set(double value) { value_.store(value, std::memory_order_relaxed); }
  double value() const { return value_.load(std::memory_order_relaxed); }

 private:
  std::atomic<double> value_{0};
};

// Distribution of durations from 1 us to 1000 s in buckets that grow by 2^(1/8): quantiles are
// right to within 4.5 %, memory is constant. Thread-safe.
class Timer {
 public:
  void Record(Duration duration);

  uint64_t count() const { return count_.load(std::memory_order_relaxed); }
  Duration total() const { return Duration(total_ns_.load(std::memory_order_relaxed)); }
  Duration max() const { return Duration(max_ns_.load(std::memory_order_relaxed)); }
  // 0 <= quantile <= 1; zero if nothing was recorded. Never above max().
  Duration Quantile(double quantile) const;

 private:
  static constexpr int kBuckets = 241;

  std::array<std::atomic<uint64_t>, kBuckets> buckets_{};
  std::atomic<uint64_t> count_{0};
  std::atomic<int64_t> total_ns_{0};
  std::atomic<int64_t> max_ns_{0};
};

// Records the time from its construction to its end.
class ScopedTimer {
 public:
  explicit ScopedTimer(Timer* timer) : timer_(timer) {}
  ~ScopedTimer() { timer_->Record(std::chrono::steady_clock::now() - start_); }
  ScopedTimer(const ScopedTimer&) = delete;
  ScopedTimer& operator=(const ScopedTimer&) = delete;

 private:
  Timer* const timer_;
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

// Owns metrics by name; the same name always gives the same object, which lives as long as the
// registry. Names are snake_case and end in their unit ("uplink_sent_bytes"). Thread-safe.
class MetricsRegistry {
 public:
  Counter* GetCounter(const std::string& name);
  Gauge* GetGauge(const std::string& name);
  Timer* GetTimer(const std::string& name);

  // Prometheus text exposition (version 0.0.4): counters as NAME_total, timers as summaries in
  // seconds. Sorted by name.
  std::string Text() const;

 private:
  mutable std::mutex mutex_;
  std::map<std::string, std::unique_ptr<Counter>> counters_ ABSL_GUARDED_BY(mutex_);
  std::map<std::string, std::unique_ptr<Gauge>> gauges_ ABSL_GUARDED_BY(mutex_);
  std::map<std::string, std::unique_ptr<Timer>> timers_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace portolan

#endif  // PORTOLAN_COMMON_METRICS_METRICS_H_
