#include "agent/tracker/track_motion.h"

#include <algorithm>
#include <array>
#include <utility>

namespace portolan {

std::optional<Eigen::Vector2d> LocalMotion(const std::vector<TrackMotion>& motions,
                                           const Eigen::Vector2d& pixel) {
  constexpr size_t kNeighbours = 5;
  if (motions.size() < kNeighbours) return std::nullopt;
  std::vector<std::pair<double, size_t>> nearest;
  for (size_t i = 0; i < motions.size(); ++i) {
    nearest.emplace_back((motions[i].from - pixel).squaredNorm(), i);
  }
  std::partial_sort(nearest.begin(), nearest.begin() + kNeighbours, nearest.end());
  std::array<double, kNeighbours> x, y;
  for (size_t i = 0; i < kNeighbours; ++i) {
    x[i] = motions[nearest[i].second].shift.x();
    y[i] = motions[nearest[i].second].shift.y();
  }
  std::sort(x.begin(), x.end());
  std::sort(y.begin(), y.end());
  return Eigen::Vector2d(x[kNeighbours / 2], y[kNeighbours / 2]);
}

}  // namespace portolan
