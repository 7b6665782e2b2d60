#include "agent/odometry/odometry_buffer.h"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "agent/image_source/sample_warning.h"

namespace portolan {

Status OdometryBufferOptions::Validate() const {
  if (!(max_gap_s > 0 && keep_s > max_gap_s && max_speed_m_s > 0)) {
    return absl::InvalidArgumentError("odometry: max_gap_s, keep_s, max_speed_m_s out of range");
  }
  return absl::OkStatus();
}

void OdometryBuffer::Add(std::span<const OdometrySample> samples) {
  for (const OdometrySample& sample : samples) {
    if (!IsUsable(sample)) continue;
    if (!samples_.empty() && IsJump(samples_.back(), sample)) {
      WarnOfSample("odometry", sample.time, "it jumps", ++counts_.jumps);
      // What lies on both sides of a jump cannot be compared.
      samples_.clear();
    }
    samples_.push_back(sample);
    ++counts_.accepted;
  }
  while (!samples_.empty() &&
         ToSeconds(samples_.back().time - samples_.front().time) > options_.keep_s) {
    samples_.pop_front();
  }
}

bool OdometryBuffer::IsUsable(const OdometrySample& sample) {
  const Rigid3& pose = sample.odometry_from_body;
  if (!pose.translation.allFinite() || !(std::abs(pose.rotation.norm() - 1) < 1e-2)) {
    WarnOfSample("odometry", sample.time, "not a pose; left out", ++counts_.not_finite);
    return false;
  }
  if (!samples_.empty() && sample.time <= samples_.back().time) {
    WarnOfSample("odometry", sample.time, "its time is not after the sample's before; left out",
                 ++counts_.out_of_order);
    return false;
  }
  return true;
}

bool OdometryBuffer::IsJump(const OdometrySample& before, const OdometrySample& after) const {
  const double way =
      (after.odometry_from_body.translation - before.odometry_from_body.translation).norm();
  return way > options_.max_speed_m_s * ToSeconds(after.time - before.time);
}

std::optional<Rigid3> OdometryBuffer::At(Timestamp time) const {
  const auto after = std::lower_bound(
      samples_.begin(), samples_.end(), time,
      [](const OdometrySample& sample, Timestamp wanted) { return sample.time < wanted; });
  const Duration max_gap = FromSeconds(options_.max_gap_s);
  if (after == samples_.end()) {
    if (samples_.empty() || time - samples_.back().time > max_gap) return std::nullopt;
    return samples_.back().odometry_from_body;
  }
  if (after->time == time) return after->odometry_from_body;
  if (after == samples_.begin()) return std::nullopt;
  const auto before = std::prev(after);
  if (after->time - before->time > max_gap) return std::nullopt;
  const double share = ToSeconds(time - before->time) / ToSeconds(after->time - before->time);
  const Rigid3 step = before->odometry_from_body.Inverse() * after->odometry_from_body;
  return before->odometry_from_body * Rigid3::Exp(share * step.Log());
}

std::optional<Rigid3> OdometryBuffer::Increment(Timestamp from, Timestamp to) const {
  const auto begin = At(from), end = At(to);
  if (!begin || !end) return std::nullopt;
  return begin->Inverse() * *end;
}

}  // namespace portolan
