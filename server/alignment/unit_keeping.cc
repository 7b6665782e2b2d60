#include "server/alignment/unit_keeping.h"

#include <algorithm>

namespace portolan {
namespace {

// Positions nearer to the origin than this share of the farthest one's distance tell no unit.
constexpr double kMinLeverOfFarthest = 0.1;

}  // namespace

Similarity3 KeepUnit(const Eigen::Vector3d& origin,
                     const std::vector<std::pair<Eigen::Vector3d, Eigen::Vector3d>>& moved) {
  double farthest = 0;
  for (const auto& [before, after] : moved) {
    farthest = std::max(farthest, (before - origin).norm());
  }
  std::vector<double> ratios;
  for (const auto& [before, after] : moved) {
    const double then = (before - origin).norm(), now = (after - origin).norm();
    if (then > kMinLeverOfFarthest * farthest && now > 0) ratios.push_back(then / now);
  }
  Similarity3 change;
  if (ratios.empty()) return change;
  const auto middle = ratios.begin() + static_cast<std::ptrdiff_t>(ratios.size() / 2);
  std::nth_element(ratios.begin(), middle, ratios.end());
  change.scale = *middle;
  change.translation = origin - change.scale * origin;
  return change;
}

}  // namespace portolan
