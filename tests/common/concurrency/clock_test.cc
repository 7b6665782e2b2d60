#include "common/concurrency/clock.h"

#include <thread>

#include "gtest/gtest.h"

namespace portolan {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

TEST(FakeClock, StandsStillUntilAdvanced) {
  FakeClock clock;
  EXPECT_EQ(clock.Now(), Duration::zero());
  clock.Advance(seconds(3));
  EXPECT_EQ(clock.Now(), seconds(3));
}

TEST(FakeClock, WaitEndsWhenTimeHasAdvanced) {
  FakeClock clock;
  std::mutex mutex;
  std::condition_variable changed;
  std::thread waiter([&] {
    std::unique_lock lock(mutex);
    EXPECT_FALSE(clock.WaitUntil(&lock, &changed, seconds(10), [] { return false; }));
    EXPECT_GE(clock.Now(), seconds(10));
  });
  while (clock.waiting() == 0) std::this_thread::yield();
  clock.Advance(seconds(9));
  clock.Advance(seconds(1));
  waiter.join();
  EXPECT_EQ(clock.waiting(), 0);
}

template <typename ClockType>
void ExpectWaitEndsByCondition(ClockType* clock) {
  std::mutex mutex;
  std::condition_variable changed;
  bool done = false;
  std::thread waiter([&] {
    std::unique_lock lock(mutex);
    EXPECT_TRUE(
        clock->WaitUntil(&lock, &changed, clock->Now() + seconds(1000), [&] { return done; }));
  });
  {
    std::unique_lock lock(mutex);
    done = true;
  }
  changed.notify_all();
  waiter.join();
}

TEST(FakeClock, WaitEndsWhenTheConditionHolds) {
  FakeClock clock;
  ExpectWaitEndsByCondition(&clock);
}

TEST(SteadyClock, WaitEndsWhenTheConditionHolds) { ExpectWaitEndsByCondition(SteadyClock::Get()); }

TEST(SteadyClock, WaitEndsAtTheDeadline) {
  SteadyClock* clock = SteadyClock::Get();
  std::mutex mutex;
  std::condition_variable changed;
  std::unique_lock lock(mutex);
  const Duration deadline = clock->Now() + milliseconds(5);
  EXPECT_FALSE(clock->WaitUntil(&lock, &changed, deadline, [] { return false; }));
  EXPECT_GE(clock->Now(), deadline);
}

}  // namespace
}  // namespace portolan
