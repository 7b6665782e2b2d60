// The samples of a laser range finder, checked; gives the one that belongs to an image.
#ifndef PORTOLAN_AGENT_RANGE_RANGE_BUFFER_H_
#define PORTOLAN_AGENT_RANGE_RANGE_BUFFER_H_

#include <cstdint>
#include <optional>
#include <span>

#include "agent/image_source/samples.h"

namespace portolan {

struct RangeSampleCounts {
  int64_t accepted = 0;
  int64_t not_finite = 0;    // or with a sigma below zero
  int64_t out_of_order = 0;  // time not after the sample's before
  int64_t no_echo = 0;       // beyond what the sensor can measure
};

// Thread-compatible.
class RangeBuffer {
 public:
  explicit RangeBuffer(const RangeFinder& finder) : finder_(finder) {}

  // Damaged samples are left out, counted, and the first of each kind are logged.
  void Add(std::span<const RangeSample> samples);

  // The newest sample up to the time, not older than max_age, once; its sigma is filled in.
  std::optional<RangeSample> Take(Timestamp time, Duration max_age);

  const RangeSampleCounts& counts() const { return counts_; }

 private:
  bool IsUsable(const RangeSample& sample);

  const RangeFinder finder_;
  std::optional<RangeSample> newest_;
  std::optional<Timestamp> last_time_;
  RangeSampleCounts counts_;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_RANGE_RANGE_BUFFER_H_
