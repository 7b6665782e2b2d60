// The wheel odometry of the last seconds, checked; gives the motion between two instants.
#ifndef PORTOLAN_AGENT_ODOMETRY_ODOMETRY_BUFFER_H_
#define PORTOLAN_AGENT_ODOMETRY_ODOMETRY_BUFFER_H_

#include <cstdint>
#include <deque>
#include <optional>
#include <span>

#include "agent/image_source/samples.h"
#include "common/base/status.h"

namespace portolan {

struct OdometryBufferOptions {
  // Between samples farther apart nothing is interpolated; the last one is held for so long [s].
  double max_gap_s = 0.3;
  double keep_s = 10;
  // No vehicle is faster; such a step is a jump of the counter [m/s].
  double max_speed_m_s = 100;

  Status Validate() const;
};

struct OdometryCounts {
  int64_t accepted = 0;
  int64_t not_finite = 0;
  int64_t out_of_order = 0;
  int64_t jumps = 0;  // the motion over a jump is unknown
};

// Thread-compatible.
class OdometryBuffer {
 public:
  explicit OdometryBuffer(const OdometryBufferOptions& options) : options_(options) {}

  // Damaged samples are left out, counted, and the first of each kind are logged.
  void Add(std::span<const OdometrySample> samples);

  // body(from)_from_body(to). No value if samples are missing there.
  std::optional<Rigid3> Increment(Timestamp from, Timestamp to) const;

  const OdometryCounts& counts() const { return counts_; }

 private:
  bool IsUsable(const OdometrySample& sample);
  std::optional<Rigid3> At(Timestamp time) const;
  bool IsJump(const OdometrySample& before, const OdometrySample& after) const;

  const OdometryBufferOptions options_;
  std::deque<OdometrySample> samples_;
  OdometryCounts counts_;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_ODOMETRY_ODOMETRY_BUFFER_H_
