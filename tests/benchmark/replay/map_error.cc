#include "tests/benchmark/replay/map_error.h"

#include <cmath>
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

}  // namespace

MapError ErrorOf(const MapSnapshot& snapshot, const std::vector<std::vector<Rigid3>>& truth) {
  MapError error;
  std::map<ComponentId, Positions> components;
  for (const auto& state : snapshot.submaps) {
    if (!state->refined->quarantine_reason.empty()) {
      ++error.quarantined;
      continue;
    }
    Positions& positions = components[state->component];
    const std::vector<Rigid3>& poses = truth[static_cast<size_t>(state->refined->id.value()) - 1];
    ++positions.submaps;
    for (size_t k = 0; k < poses.size(); ++k) {
      positions.estimate.push_back(state->world_from_camera[k].translation);
      positions.truth.push_back(poses[k].translation);
      if (k > 0) positions.path_m += (poses[k].translation - poses[k - 1].translation).norm();
    }
  }
  error.components = static_cast<int>(components.size());
  for (const Closure& closure : *snapshot.closures) {
    ++(IsRight(closure, snapshot, truth) ? error.accepted_right : error.accepted_wrong);
  }
  for (const Closure& closure : *snapshot.waiting_closures) {
    ++(IsRight(closure, snapshot, truth) ? error.waiting_right : error.waiting_wrong);
  }
  for (const auto& [id, positions] : components) {
    if (positions.submaps <= error.submaps) continue;
    const auto aligned = AlignPoints(positions.estimate, positions.truth, AlignmentMode::kSim3);
    if (!aligned) continue;
    double sum = 0;
    for (size_t i = 0; i < positions.truth.size(); ++i) {
      sum += (*aligned * positions.estimate[i] - positions.truth[i]).squaredNorm();
    }
    error.submaps = positions.submaps;
    error.path_m = positions.path_m;
    error.ate_m = std::sqrt(sum / static_cast<double>(positions.truth.size()));
  }
  return error;
}

}  // namespace portolan
