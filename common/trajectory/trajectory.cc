#include "common/trajectory/trajectory.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_cat.h"

namespace portolan {
namespace {

bool TimeBefore(const StampedPose& pose, Timestamp time) { return pose.time < time; }

// Index of the pose of a non-empty trajectory whose time is nearest to `time`; the earlier of two.
size_t NearestIndex(const Trajectory& trajectory, Timestamp time) {
  const auto after = std::lower_bound(trajectory.begin(), trajectory.end(), time, TimeBefore);
  if (after == trajectory.begin()) return 0;
  const size_t index = static_cast<size_t>(after - trajectory.begin());
  if (after == trajectory.end()) return index - 1;
  return after->time - time < time - (after - 1)->time ? index : index - 1;
}

}  // namespace

Status ValidateTrajectory(const Trajectory& trajectory) {
  for (size_t i = 0; i < trajectory.size(); ++i) {
    const Rigid3& pose = trajectory[i].world_from_body;
    if (!pose.translation.allFinite() || !pose.rotation.coeffs().allFinite()) {
      return absl::InvalidArgumentError(absl::StrCat("pose ", i, ": a number is not finite"));
    }
    if (std::abs(pose.rotation.norm() - 1.0) > 1e-6) {
      return absl::InvalidArgumentError(absl::StrCat("pose ", i, ": quaternion not of unit norm"));
    }
    if (i > 0 && trajectory[i].time <= trajectory[i - 1].time) {
      return absl::InvalidArgumentError(absl::StrCat("pose ", i, ": time does not ascend (",
                                                     trajectory[i].time.count(), " ns after ",
                                                     trajectory[i - 1].time.count(), " ns)"));
    }
  }
  return absl::OkStatus();
}

double PathLength(std::span<const StampedPose> trajectory) {
  return trajectory.empty() ? 0.0 : CumulativePathLength(trajectory).back();
}

std::vector<double> CumulativePathLength(std::span<const StampedPose> trajectory) {
  std::vector<double> lengths;
  lengths.reserve(trajectory.size());
  for (size_t i = 0; i < trajectory.size(); ++i) {
    const double step = i == 0 ? 0.0
                               : (trajectory[i].world_from_body.translation -
                                  trajectory[i - 1].world_from_body.translation)
                                     .norm();
    lengths.push_back((i == 0 ? 0.0 : lengths.back()) + step);
  }
  return lengths;
}

std::optional<Rigid3> InterpolatePose(const Trajectory& trajectory, Timestamp time,
                                      Duration max_gap) {
  const auto after = std::lower_bound(trajectory.begin(), trajectory.end(), time, TimeBefore);
  if (after == trajectory.end()) return std::nullopt;
  if (after->time == time) return after->world_from_body;
  if (after == trajectory.begin()) return std::nullopt;
  const auto before = after - 1;
  const Duration gap = after->time - before->time;
  if (gap > max_gap) return std::nullopt;
  const double share = ToSeconds(time - before->time) / ToSeconds(gap);
  const Rigid3& a = before->world_from_body;
  const Rigid3& b = after->world_from_body;
  return Rigid3{a.rotation.slerp(share, b.rotation),
                (1.0 - share) * a.translation + share * b.translation};
}

Trajectory ResampleTrajectory(const Trajectory& trajectory, std::span<const Timestamp> times,
                              Duration max_gap) {
  Trajectory resampled;
  for (const Timestamp time : times) {
    const std::optional<Rigid3> pose = InterpolatePose(trajectory, time, max_gap);
    if (pose) resampled.push_back({time, *pose});
  }
  return resampled;
}

std::vector<IndexPair> AssociateByTime(const Trajectory& estimate, const Trajectory& reference,
                                       Duration max_difference) {
  std::vector<IndexPair> pairs;
  if (estimate.empty() || reference.empty()) return pairs;
  for (size_t i = 0; i < estimate.size(); ++i) {
    const size_t j = NearestIndex(reference, estimate[i].time);
    const Duration difference = std::chrono::abs(estimate[i].time - reference[j].time);
    if (difference > max_difference) continue;
    // Estimates come in ascending order, so only the previous pair can hold the same reference.
    if (!pairs.empty() && pairs.back().reference == j) {
      const Duration other =
          std::chrono::abs(estimate[pairs.back().estimate].time - reference[j].time);
      if (difference >= other) continue;
      pairs.pop_back();
    }
    pairs.push_back({i, j});
  }
  return pairs;
}

}  // namespace portolan
