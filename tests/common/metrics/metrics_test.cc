#include "common/metrics/metrics.h"

#include <thread>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace portolan {
namespace {

using std::chrono::microseconds;
using std::chrono::milliseconds;
using testing::HasSubstr;

TEST(Timer, QuantilesAreRightToTheStatedAccuracy) {
  Timer timer;
  for (int i = 1; i <= 1000; ++i) timer.Record(milliseconds(i));
  EXPECT_EQ(timer.count(), 1000u);
  EXPECT_EQ(timer.total(), milliseconds(500500));
  EXPECT_EQ(timer.max(), milliseconds(1000));
  for (const double q : {0.01, 0.5, 0.95, 0.99}) {
    EXPECT_NEAR(ToSeconds(timer.Quantile(q)), q, 0.045 * q) << q;
  }
  EXPECT_LE(timer.Quantile(1.0), timer.max());
}

TEST(Timer, HandlesNothingAndExtremes) {
  Timer timer;
  EXPECT_EQ(timer.Quantile(0.5), Duration::zero());
  timer.Record(Duration(-5));
  timer.Record(Duration::zero());
  EXPECT_EQ(timer.max(), Duration::zero());
  EXPECT_EQ(timer.Quantile(1.0), Duration::zero());
  timer.Record(std::chrono::hours(10));
  EXPECT_EQ(timer.max(), std::chrono::hours(10));
  EXPECT_GT(timer.Quantile(1.0), std::chrono::seconds(900));
}

TEST(Counter, AddsFromManyThreads) {
  Counter counter;
  Timer timer;
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t) {
    threads.emplace_back([&] {
      for (int i = 0; i < 1000; ++i) {
        counter.Add(2);
        timer.Record(microseconds(i));
      }
    });
  }
  for (auto& thread : threads) thread.join();
  EXPECT_EQ(counter.value(), 8000u);
  EXPECT_EQ(timer.count(), 4000u);
}

TEST(ScopedTimer, RecordsOnce) {
  Timer timer;
  { const ScopedTimer scoped(&timer); }
  EXPECT_EQ(timer.count(), 1u);
}

TEST(MetricsRegistry, KeepsOneObjectAName) {
  MetricsRegistry registry;
  EXPECT_EQ(registry.GetCounter("a_bytes"), registry.GetCounter("a_bytes"));
  EXPECT_NE(registry.GetCounter("a_bytes"), registry.GetCounter("b_bytes"));
}

TEST(MetricsRegistry, WritesPrometheusText) {
  MetricsRegistry registry;
  registry.GetCounter("frames")->Add(3);
  registry.GetGauge("queue_size")->Set(1.5);
  registry.GetTimer("frame_seconds")->Record(milliseconds(10));
  const std::string text = registry.Text();
  EXPECT_THAT(text, HasSubstr("# TYPE frames_total counter\nframes_total 3\n"));
  EXPECT_THAT(text, HasSubstr("# TYPE queue_size gauge\nqueue_size 1.5\n"));
  EXPECT_THAT(text, HasSubstr("frame_seconds_sum 0.01\nframe_seconds_count 1\n"));
  EXPECT_THAT(text, HasSubstr("frame_seconds{quantile=\"0.95\"} 0.0"));
}

}  // namespace
}  // namespace portolan
