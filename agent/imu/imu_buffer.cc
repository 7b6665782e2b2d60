#include "agent/imu/imu_buffer.h"

#include <algorithm>

#include "agent/image_source/sample_warning.h"

namespace portolan {

Status ImuBufferOptions::Validate() const {
  if (!(max_gap_s > 0 && keep_s > max_gap_s && max_gyro_rad_s > 0 && max_accel_m_s2 > 0)) {
    return absl::InvalidArgumentError("imu: max_gap_s, keep_s and the ranges must be positive");
  }
  return absl::OkStatus();
}

void ImuBuffer::Add(std::span<const ImuSample> samples) {
  for (const ImuSample& sample : samples) {
    if (!IsUsable(sample)) continue;
    if (!samples_.empty() && IsGap(samples_.back().time, sample.time)) {
      WarnOfSample("IMU sample", sample.time, "a gap before it", ++counts_.gaps);
    }
    samples_.push_back(sample);
    ++counts_.accepted;
  }
  while (!samples_.empty() &&
         ToSeconds(samples_.back().time - samples_.front().time) > options_.keep_s) {
    samples_.pop_front();
  }
}

bool ImuBuffer::IsUsable(const ImuSample& sample) {
  if (!sample.gyro_rad_s.allFinite() || !sample.accel_m_s2.allFinite()) {
    WarnOfSample("IMU sample", sample.time, "not a number; left out", ++counts_.not_finite);
    return false;
  }
  if (sample.gyro_rad_s.cwiseAbs().maxCoeff() > options_.max_gyro_rad_s ||
      sample.accel_m_s2.cwiseAbs().maxCoeff() > options_.max_accel_m_s2) {
    WarnOfSample("IMU sample", sample.time, "beyond the range of a sensor; left out",
                 ++counts_.beyond_range);
    return false;
  }
  if (!samples_.empty() && sample.time <= samples_.back().time) {
    WarnOfSample("IMU sample", sample.time, "its time is not after the sample's before; left out",
                 ++counts_.out_of_order);
    return false;
  }
  return true;
}

bool ImuBuffer::IsGap(Timestamp from, Timestamp to) const {
  return ToSeconds(to - from) > options_.max_gap_s;
}

// Interpolated between the samples index - 1 and index; held before the first and after the last.
ImuSample ImuBuffer::At(size_t index, Timestamp time) const {
  if (index == 0) return samples_.front();
  if (index == samples_.size()) return samples_.back();
  const ImuSample &before = samples_[index - 1], &after = samples_[index];
  const double share = ToSeconds(time - before.time) / ToSeconds(after.time - before.time);
  ImuSample at = before;
  at.gyro_rad_s += share * (after.gyro_rad_s - before.gyro_rad_s);
  at.accel_m_s2 += share * (after.accel_m_s2 - before.accel_m_s2);
  return at;
}

std::vector<ImuStep> ImuBuffer::Steps(Timestamp from, Timestamp to) const {
  std::vector<ImuStep> steps;
  if (to <= from) return steps;
  if (samples_.empty()) {
    steps.push_back(
        {ToSeconds(to - from), Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero(), false});
    return steps;
  }
  // The first sample after `from` ends the first step.
  size_t next =
      std::upper_bound(samples_.begin(), samples_.end(), from,
                       [](Timestamp time, const ImuSample& sample) { return time < sample.time; }) -
      samples_.begin();
  Timestamp begin = from;
  ImuSample at_begin = At(next, from);
  while (begin < to) {
    const Timestamp end = next < samples_.size() ? std::min(samples_[next].time, to) : to;
    const ImuSample at_end = At(next, end);
    // The times between which the rates are known only by their ends.
    const Timestamp known_from = next == 0 ? begin : samples_[next - 1].time;
    const Timestamp known_to = next < samples_.size() ? samples_[next].time : end;
    steps.push_back({ToSeconds(end - begin), 0.5 * (at_begin.gyro_rad_s + at_end.gyro_rad_s),
                     0.5 * (at_begin.accel_m_s2 + at_end.accel_m_s2),
                     !IsGap(known_from, known_to)});
    begin = end;
    at_begin = at_end;
    ++next;
  }
  return steps;
}

}  // namespace portolan
