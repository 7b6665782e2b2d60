#include "common/metrics/metrics.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_cat.h"

namespace portolan {
namespace {

constexpr double kFirstBucket_ns = 1000;
constexpr double kBucketsPerOctave = 8;

int BucketOf(int64_t duration_ns, int bucket_count) {
  if (static_cast<double>(duration_ns) <= kFirstBucket_ns) return 0;
  const double octaves = std::log2(static_cast<double>(duration_ns) / kFirstBucket_ns);
  return std::min(static_cast<int>(std::ceil(kBucketsPerOctave * octaves)), bucket_count - 1);
}

// Geometric middle of the bucket.
Duration MiddleOf(int bucket) {
  const double octaves = (static_cast<double>(bucket) - 0.5) / kBucketsPerOctave;
  return Duration(std::llround(kFirstBucket_ns * std::exp2(octaves)));
}

template <typename T>
T* GetOrCreate(const std::string& name, std::map<std::string, std::unique_ptr<T>>* metrics) {
  auto& metric = (*metrics)[name];
  if (metric == nullptr) metric = std::make_unique<T>();
  return metric.get();
}

}  // namespace

void Timer::Record(Duration duration) {
  const int64_t ns = std::max<int64_t>(0, duration.count());
  buckets_[static_cast<size_t>(BucketOf(ns, kBuckets))].fetch_add(1, std::memory_order_relaxed);
  count_.fetch_add(1, std::memory_order_relaxed);
  total_ns_.fetch_add(ns, std::memory_order_relaxed);
  int64_t max_ns = max_ns_.load(std::memory_order_relaxed);
  while (ns > max_ns && !max_ns_.compare_exchange_weak(max_ns, ns, std::memory_order_relaxed)) {
  }
}

Duration Timer::Quantile(double quantile) const {
  std::array<uint64_t, kBuckets> counts;
  uint64_t sum = 0;
  for (size_t i = 0; i < counts.size(); ++i) {
    sum += counts[i] = buckets_[i].load(std::memory_order_relaxed);
  }
  if (sum == 0) return Duration::zero();
  const double share = std::clamp(quantile, 0.0, 1.0);
  const auto rank =
      std::max<uint64_t>(1, static_cast<uint64_t>(std::ceil(share * static_cast<double>(sum))));
  uint64_t below = 0;
  size_t bucket = 0;
  while (below + counts[bucket] < rank) below += counts[bucket++];
  return std::min(MiddleOf(static_cast<int>(bucket)), max());
}

Counter* MetricsRegistry::GetCounter(const std::string& name) {
  std::unique_lock lock(mutex_);
  return GetOrCreate(name, &counters_);
}

Gauge* MetricsRegistry::GetGauge(const std::string& name) {
  std::unique_lock lock(mutex_);
  return GetOrCreate(name, &gauges_);
}

Timer* MetricsRegistry::GetTimer(const std::string& name) {
  std::unique_lock lock(mutex_);
  return GetOrCreate(name, &timers_);
}

std::string MetricsRegistry::Text() const {
  std::unique_lock lock(mutex_);
  std::string text;
  for (const auto& [name, counter] : counters_) {
    absl::StrAppend(&text, "# TYPE ", name, "_total counter\n", name, "_total ", counter->value(),
                    "\n");
  }
  for (const auto& [name, gauge] : gauges_) {
    absl::StrAppend(&text, "# TYPE ", name, " gauge\n", name, " ", gauge->value(), "\n");
  }
  for (const auto& [name, timer] : timers_) {
    absl::StrAppend(&text, "# TYPE ", name, " summary\n");
    for (const double quantile : {0.5, 0.95, 0.99}) {
      absl::StrAppend(&text, name, "{quantile=\"", quantile, "\"} ",
                      ToSeconds(timer->Quantile(quantile)), "\n");
    }
    absl::StrAppend(&text, name, "_sum ", ToSeconds(timer->total()), "\n", name, "_count ",
                    timer->count(), "\n");
  }
  return text;
}

}  // namespace portolan
