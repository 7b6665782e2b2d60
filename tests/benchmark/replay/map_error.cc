#include "tests/benchmark/replay/map_error.h"

#include <algorithm>
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
