#include "common/trajectory/relative_error.h"

#include <cmath>

namespace portolan {
namespace {

constexpr double kLongestInterval = 1.5;  // of the nominal length
constexpr size_t kKittiStep = 10;         // poses: one second at 10 Hz

// (reference_a^-1 reference_b)^-1 (estimate_a^-1 estimate_b), Sturm et al. Eq. 1.
Rigid3 RelativeErrorBetween(const MatchedPose& a, const MatchedPose& b) {
  const Rigid3 reference = a.reference.Inverse() * b.reference;
  const Rigid3 estimate = a.estimate.Inverse() * b.estimate;
  return reference.Inverse() * estimate;
}

void Append(const Rigid3& error, double length, RelativeRates* rates) {
  rates->translation.push_back(error.translation.norm() / length);
  rates->rotation_rad.push_back(RotationLog(error.rotation).norm() / length);
}

// `position(i)` ascends with i; rounding at the interval's end is forgiven.
template <typename Position>
RelativeRates RatesOver(std::span<const MatchedPose> poses, double length,
                        const Position& position) {
  RelativeRates rates;
  size_t last = 0;
  for (size_t first = 0; first < poses.size(); ++first) {
    while (last < poses.size() && position(last) - position(first) < length * (1.0 - 1e-9)) ++last;
    if (last == poses.size()) break;
    const double interval = position(last) - position(first);
    if (interval > kLongestInterval * length) continue;
    Append(RelativeErrorBetween(poses[first], poses[last]), interval, &rates);
  }
  return rates;
}

}  // namespace

RelativeRates RatesPerMetre(std::span<const MatchedPose> poses, double length_m) {
  return RatesOver(poses, length_m, [&](size_t i) { return poses[i].path_m; });
}

RelativeRates RatesPerSecond(std::span<const MatchedPose> poses, double length_s) {
  return RatesOver(poses, length_s,
                   [&](size_t i) { return ToSeconds(poses[i].time - poses[0].time); });
}

RelativeRates KittiSegments(std::span<const MatchedPose> poses) {
  RelativeRates rates;
  for (size_t first = 0; first < poses.size(); first += kKittiStep) {
    size_t last = first;
    for (int hundreds = 1; hundreds <= 8; ++hundreds) {
      const double length_m = 100.0 * hundreds;
      while (last < poses.size() && poses[last].path_m <= poses[first].path_m + length_m) ++last;
      if (last == poses.size()) break;
      Append(RelativeErrorBetween(poses[first], poses[last]), length_m, &rates);
    }
  }
  return rates;
}

}  // namespace portolan
