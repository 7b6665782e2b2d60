#include "common/concurrency/clock.h"

namespace portolan {
namespace {

using SteadyTime = std::chrono::steady_clock::time_point;

}  // namespace

SteadyClock* SteadyClock::Get() {
  static SteadyClock clock;
  return &clock;
}

Duration SteadyClock::Now() const {
  return std::chrono::duration_cast<Duration>(std::chrono::steady_clock::now().time_since_epoch());
}

bool SteadyClock::WaitUntil(std::unique_lock<std::mutex>* lock, std::condition_variable* changed,
                            Duration deadline, const std::function<bool()>& condition) {
  const auto time = SteadyTime(std::chrono::duration_cast<SteadyTime::duration>(deadline));
  return changed->wait_until(*lock, time, condition);
}

bool FakeClock::WaitUntil(std::unique_lock<std::mutex>* lock, std::condition_variable* changed,
                          Duration deadline, const std::function<bool()>& condition) {
  ++waiting_;
  bool is_true = condition();
  while (!is_true && Now() < deadline) {
    changed->wait_for(*lock, std::chrono::milliseconds(1));
    is_true = condition();
  }
  --waiting_;
  return is_true;
}

}  // namespace portolan
