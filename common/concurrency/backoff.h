// How long to wait before the next attempt after failures: exponential growth with jitter, so
// that a fleet does not come back all at once.
#ifndef PORTOLAN_COMMON_CONCURRENCY_BACKOFF_H_
#define PORTOLAN_COMMON_CONCURRENCY_BACKOFF_H_

#include <cstdint>
#include <random>

#include "common/base/status.h"
#include "common/base/time.h"
#include "common/concurrency/clock.h"

namespace portolan {

struct BackoffOptions {
  // After the first failure; short, for a restarting server is back within a second.
  Duration initial = std::chrono::milliseconds(200);
  // Never longer; a vehicle that comes into range should not idle for long.
  Duration max = std::chrono::seconds(10);
  // Growth from failure to failure.
  double factor = 2.0;
  // Each wait is drawn from [1 - jitter, 1] of its nominal length.
  double jitter = 0.5;
  // An attempt that lasted at least this long was a success, even if it broke later.
  Duration success_after = std::chrono::seconds(10);

  Status Validate() const;
};

// Thread-compatible. `clock` must outlive it.
//
//   backoff.AttemptStarted();  ... it failed ...
//   wait until backoff.AttemptFailed();  again
class Backoff {
 public:
  Backoff(const BackoffOptions& options, uint64_t seed, Clock* clock);

  void AttemptStarted();
  // Clock time at which the next attempt is due.
  Duration AttemptFailed();
  // The next failure counts as the first.
  void Reset();
  // Failures since the last success.
  int failures() const { return failures_; }

 private:
  const BackoffOptions options_;
  Clock* const clock_;
  std::mt19937_64 random_;
  Duration started_{};
  int failures_ = 0;
};

}  // namespace portolan

#endif  // PORTOLAN_COMMON_CONCURRENCY_BACKOFF_H_
