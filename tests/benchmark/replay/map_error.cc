#include "tests/benchmark/replay/map_error.h"

#include <cmath>
#include <limits>
#include <map>

#include "common/trajectory/alignment.h"

namespace portolan {
namespace {

struct Positions {
  std::vector<Eigen::Vector3d> estimate;
  std::vector<Eigen::Vector3d> truth;
  int submaps = 0;
  double path_m = 0;
};

// Within 0.1 rad, and a metre and a tenth of the distance; a's unit is told by how far apart its
// ends are.
bool IsRight(const Closure& closure, const MapSnapshot& snapshot,
             const std::vector<std::vector<Rigid3>>& truth) {
  const auto index = [](SubmapId id) { return static_cast<size_t>(id.value()) - 1; };
  const std::vector<Rigid3>& a = truth[index(closure.a)];
  const std::vector<Rigid3>& b = truth[index(closure.b)];
  const RefinedSubmap& refined = *snapshot.submaps[index(closure.a)]->refined;
  const double unit = refined.submap_from_camera.back().translation.norm() /
                      (a.back().translation - a.front().translation).norm();
  const Rigid3 expected = a.front().Inverse() * b.front();
  const double distance = (closure.a_from_b.translation / unit - expected.translation).norm();
  return closure.a_from_b.rotation.angularDistance(expected.rotation) < 0.1 &&
         distance < 1 + 0.1 * expected.translation.norm();
}

std::map<ComponentId, Positions> ComponentsOf(const MapSnapshot& snapshot,
                                              const std::vector<std::vector<Rigid3>>& truth) {
  std::map<ComponentId, Positions> components;
  for (const auto& state : snapshot.submaps) {
    if (!state->refined->quarantine_reason.empty()) continue;
    Positions& positions = components[state->component];
    const std::vector<Rigid3>& poses = truth[static_cast<size_t>(state->refined->id.value()) - 1];
    ++positions.submaps;
    for (size_t k = 0; k < poses.size(); ++k) {
      positions.estimate.push_back(state->world_from_camera[k].translation);
      positions.truth.push_back(poses[k].translation);
      if (k > 0) positions.path_m += (poses[k].translation - poses[k - 1].translation).norm();
    }
  }
  return components;
}

const Positions* LargestOf(const std::map<ComponentId, Positions>& components) {
  const Positions* largest = nullptr;
  for (const auto& [id, positions] : components) {
    if (largest == nullptr || positions.submaps > largest->submaps) largest = &positions;
  }
  return largest;
}

// After the Sim(3) alignment to `reference`; NaN where there is none.
double RmsAligned(const std::vector<Eigen::Vector3d>& points,
                  const std::vector<Eigen::Vector3d>& reference) {
  const auto aligned = AlignPoints(points, reference, AlignmentMode::kSim3);
  if (!aligned) return std::numeric_limits<double>::quiet_NaN();
  double sum = 0;
  for (size_t i = 0; i < points.size(); ++i) {
    sum += (*aligned * points[i] - reference[i]).squaredNorm();
  }
  return std::sqrt(sum / static_cast<double>(points.size()));
}

}  // namespace

MapError ErrorOf(const MapSnapshot& snapshot, const std::vector<std::vector<Rigid3>>& truth) {
  MapError error;
  for (const auto& state : snapshot.submaps) {
    error.quarantined += state->refined->quarantine_reason.empty() ? 0 : 1;
  }
  const std::map<ComponentId, Positions> components = ComponentsOf(snapshot, truth);
  error.components = static_cast<int>(components.size());
  for (const Closure& closure : *snapshot.closures) {
    ++(IsRight(closure, snapshot, truth) ? error.accepted_right : error.accepted_wrong);
  }
  for (const Closure& closure : *snapshot.waiting_closures) {
    ++(IsRight(closure, snapshot, truth) ? error.waiting_right : error.waiting_wrong);
  }
  const Positions* largest = LargestOf(components);
  if (largest == nullptr) return error;
  error.submaps = largest->submaps;
  error.path_m = largest->path_m;
  error.ate_m = RmsAligned(largest->estimate, largest->truth);
  return error;
}

double DistanceBetween(const MapSnapshot& a, const MapSnapshot& b,
                       const std::vector<std::vector<Rigid3>>& truth) {
  const auto components_a = ComponentsOf(a, truth), components_b = ComponentsOf(b, truth);
  const Positions* largest_a = LargestOf(components_a);
  const Positions* largest_b = LargestOf(components_b);
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  if (largest_a == nullptr || largest_b == nullptr) return kNone;
  if (largest_a->truth != largest_b->truth) return kNone;
  const auto metric = AlignPoints(largest_b->estimate, largest_b->truth, AlignmentMode::kSim3);
  if (!metric) return kNone;
  return metric->scale * RmsAligned(largest_a->estimate, largest_b->estimate);
}

}  // namespace portolan
