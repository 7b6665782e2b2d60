#include "agent/range/range_buffer.h"

#include <cmath>
#include <utility>

#include "agent/image_source/sample_warning.h"

namespace portolan {

void RangeBuffer::Add(std::span<const RangeSample> samples) {
  for (const RangeSample& sample : samples) {
    if (!IsUsable(sample)) continue;
    ++counts_.accepted;
    newest_ = sample;
    if (newest_->sigma_m == 0) newest_->sigma_m = finder_.sigma_m;
  }
}

bool RangeBuffer::IsUsable(const RangeSample& sample) {
  if (!std::isfinite(sample.range_m) || !std::isfinite(sample.sigma_m) || sample.sigma_m < 0) {
    WarnOfSample("range", sample.time, "not a number; left out", ++counts_.not_finite);
    return false;
  }
  if (last_time_ && sample.time <= *last_time_) {
    WarnOfSample("range", sample.time, "its time is not after the sample's before; left out",
                 ++counts_.out_of_order);
    return false;
  }
  last_time_ = sample.time;
  // The sky and black surfaces send nothing back: no reason for a warning.
  const bool echo = sample.range_m >= finder_.min_range_m && sample.range_m <= finder_.max_range_m;
  if (!echo) ++counts_.no_echo;
  return echo;
}

std::optional<RangeSample> RangeBuffer::Take(Timestamp time, Duration max_age) {
  if (!newest_ || newest_->time > time) return std::nullopt;
  const RangeSample sample = *std::exchange(newest_, std::nullopt);
  if (time - sample.time > max_age) return std::nullopt;
  return sample;
}

}  // namespace portolan
