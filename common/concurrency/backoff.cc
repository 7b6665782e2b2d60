#include "common/concurrency/backoff.h"

#include <algorithm>
#include <cmath>

namespace portolan {

Status BackoffOptions::Validate() const {
  if (initial <= Duration::zero()) {
    return absl::InvalidArgumentError("backoff.initial: not positive");
  }
  if (max < initial) return absl::InvalidArgumentError("backoff.max: below initial");
  if (!(factor >= 1.0)) return absl::InvalidArgumentError("backoff.factor: below 1");
  if (!(jitter >= 0.0 && jitter < 1.0)) {
    return absl::InvalidArgumentError("backoff.jitter: not in [0, 1)");
  }
  if (success_after <= Duration::zero()) {
    return absl::InvalidArgumentError("backoff.success_after: not positive");
  }
  return absl::OkStatus();
}

Backoff::Backoff(const BackoffOptions& options, uint64_t seed, Clock* clock)
    : options_(options), clock_(clock), random_(seed), started_(clock->Now()) {}

void Backoff::AttemptStarted() { started_ = clock_->Now(); }

Duration Backoff::AttemptFailed() {
  const Duration now = clock_->Now();
  if (now - started_ >= options_.success_after) Reset();
  const double nominal_s = std::min(
      ToSeconds(options_.initial) * std::pow(options_.factor, failures_), ToSeconds(options_.max));
  failures_ = std::min(failures_ + 1, 1000);
  const double share =
      1.0 - options_.jitter * std::uniform_real_distribution<double>(0, 1)(random_);
  return now + FromSeconds(nominal_s * share);
}

void Backoff::Reset() { failures_ = 0; }

}  // namespace portolan
