#include "tests/support/synthetic_map.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <atomic>

#include "common/base/check.h"

namespace portolan {
namespace {

struct Positions {
  std::vector<Eigen::Vector3d> estimate;
  std::vector<Eigen::Vector3d> truth;
};

Positions KeyframePositions(const SyntheticMission& mission, const MapSnapshot& snapshot,
                            ComponentId component) {
  Positions positions;
  for (const auto& state : snapshot.submaps) {
    if (state->component != component) continue;
    const SyntheticSubmap& truth = mission.submaps[state->refined->id.value() - 1];
    for (size_t k = 0; k < state->world_from_camera.size(); ++k) {
      positions.estimate.push_back(state->world_from_camera[k].translation);
      positions.truth.push_back(truth.world_from_camera[k].translation);
    }
  }
  return positions;
}

}  // namespace

void IntegrateMission(const SyntheticMission& mission, size_t begin, size_t end, bool polish,
                      MapBuilder* builder) {
  for (size_t i = begin; i < std::min(end, mission.submaps.size()); ++i) {
    builder->IntegrateSubmap({mission.submaps[i].id, mission.submaps[i].submap, mission.camera});
    if (polish) FinishBackgroundWork(builder);
  }
}

void FinishBackgroundWork(MapBuilder* builder) {
  const std::atomic<bool> never = false;
  while (builder->HasBackgroundWork()) builder->RunBackgroundWork(never);
}

double KeyframeRms(const SyntheticMission& mission, const MapSnapshot& snapshot,
                   ComponentId component, bool with_scale) {
  const Positions positions = KeyframePositions(mission, snapshot, component);
  return AlignedRms(positions.estimate, positions.truth, with_scale);
}

double LandmarkMedianError(const SyntheticMission& mission, const MapSnapshot& snapshot,
                           ComponentId component) {
  const Positions positions = KeyframePositions(mission, snapshot, component);
  Eigen::Matrix3Xd a(3, positions.estimate.size()), b(3, positions.estimate.size());
  for (size_t i = 0; i < positions.estimate.size(); ++i) {
    a.col(i) = positions.estimate[i];
    b.col(i) = positions.truth[i];
  }
  const Eigen::Matrix4d truth_from_world = Eigen::umeyama(a, b, true);
  std::vector<double> errors;
  for (const auto& state : snapshot.submaps) {
    if (state->component != component) continue;
    for (const FusedLandmark& landmark : state->landmarks) {
      const LandmarkSight& sight = landmark.sights.front();
      const int agent = mission.agent_of_submap[sight.submap.value() - 1];
      const Eigen::Vector3d& truth = mission.points_of_tracks[agent].at(sight.track);
      errors.push_back(
          ((truth_from_world * landmark.point_in_world.homogeneous()).head<3>() - truth).norm());
    }
  }
  PORTOLAN_CHECK(!errors.empty());
  std::nth_element(errors.begin(), errors.begin() + errors.size() / 2, errors.end());
  return errors[errors.size() / 2];
}

}  // namespace portolan
