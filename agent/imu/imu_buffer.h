// The IMU samples of the last seconds, checked, and cut into steps between two instants.
#ifndef PORTOLAN_AGENT_IMU_IMU_BUFFER_H_
#define PORTOLAN_AGENT_IMU_IMU_BUFFER_H_

#include <cstdint>
#include <deque>
#include <span>
#include <vector>

#include "agent/image_source/samples.h"
#include "common/base/status.h"

namespace portolan {

struct ImuBufferOptions {
  // Samples farther apart than this leave a gap: what happened in between is unknown [s].
  double max_gap_s = 0.05;
  // Samples are kept so long; the initialisation looks back that far at most [s].
  double keep_s = 12;
  // Beyond the range of any sensor; such a number is a damaged sample.
  double max_gyro_rad_s = 60;
  double max_accel_m_s2 = 400;

  Status Validate() const;
};

// What became of the samples.
struct ImuCounts {
  int64_t accepted = 0;
  int64_t not_finite = 0;
  int64_t beyond_range = 0;
  int64_t out_of_order = 0;  // time not after the sample before
  int64_t gaps = 0;          // between accepted samples

  int64_t refused() const { return not_finite + beyond_range + out_of_order; }
};

// Mean rates over a short time, by linear interpolation of the samples.
struct ImuStep {
  double dt_s = 0;
  Eigen::Vector3d gyro_rad_s = Eigen::Vector3d::Zero();
  Eigen::Vector3d accel_m_s2 = Eigen::Vector3d::Zero();
  // False in a gap: the rates are a guess.
  bool measured = true;
};

// Thread-compatible.
class ImuBuffer {
 public:
  explicit ImuBuffer(const ImuBufferOptions& options) : options_(options) {}

  // Damaged samples are left out, counted, and the first of each kind are logged.
  void Add(std::span<const ImuSample> samples);

  // Steps that cover [from, to] without a hole. The ends are interpolated; beyond the last sample
  // its rates are held for max_gap_s. Where there are no samples at all: one unmeasured step of
  // zero rates. Empty if to <= from.
  std::vector<ImuStep> Steps(Timestamp from, Timestamp to) const;

  const std::deque<ImuSample>& samples() const { return samples_; }
  const ImuCounts& counts() const { return counts_; }

 private:
  bool IsUsable(const ImuSample& sample);
  ImuSample At(size_t index, Timestamp time) const;
  bool IsGap(Timestamp from, Timestamp to) const;

  const ImuBufferOptions options_;
  std::deque<ImuSample> samples_;
  ImuCounts counts_;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_IMU_IMU_BUFFER_H_
