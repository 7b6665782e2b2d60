#include "server/fusion/map_fuser.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <utility>
#include <vector>

namespace portolan {
namespace {

// Adds the information of one observation about the point in the world.
void AddInformation(const Rigid3& world_from_camera, const CameraModel& camera,
                    const Eigen::Vector3d& point_in_world, const Observation& observation,
                    Eigen::Matrix3d* information) {
  const Eigen::Matrix3d camera_from_world =
      world_from_camera.rotation.conjugate().toRotationMatrix();
  Matrix23d jacobian;
  if (!camera.Project(camera_from_world * (point_in_world - world_from_camera.translation),
                      &jacobian)) {
    return;
  }
  jacobian = (jacobian * camera_from_world / observation.sigma_px).eval();
  information->noalias() += jacobian.transpose().lazyProduct(jacobian);
}

// The previous list if it is the same still; elements are compared by address.
std::shared_ptr<const ClosureList> Shared(const std::shared_ptr<const ClosureList>& previous,
                                          const ClosureList& now) {
  if (previous != nullptr && *previous == now) return previous;
  return std::make_shared<const ClosureList>(now);
}

void AddToComponent(const SubmapState& state, ComponentState* component) {
  component->id = state.component;
  if (!state.refined->quarantine_reason.empty()) return;
  const Submap& raw = *state.refined->raw;
  component->metric = component->metric || raw.metric;
  component->gravity_aligned = component->gravity_aligned || raw.gravity_in_submap.has_value();
}

bool IsInSite(const ComponentState& component) {
  return component.georeference && component.georeference->is_georeferenced;
}

// Some component is no longer metric for being georeferenced.
bool LeftTheSite(
    const MapSnapshot& previous,
    const std::map<ComponentId, std::shared_ptr<const GeoreferenceReport>>& georeferences) {
  return std::any_of(previous.components.begin(), previous.components.end(),
                     [&](const auto& component) {
                       const auto known = georeferences.find(component.id);
                       return IsInSite(component) &&
                              (known == georeferences.end() || !known->second->is_georeferenced);
                     });
}

// Those of the version before and, as long as nobody changed sides, of the new submaps.
std::vector<ComponentState> Components(
    const MapSnapshot& previous, const std::vector<std::shared_ptr<const SubmapState>>& states,
    const std::map<ComponentId, std::shared_ptr<const GeoreferenceReport>>& georeferences) {
  std::map<ComponentId, ComponentState> components;
  for (const ComponentState& component : previous.components) components[component.id] = component;
  bool some_changed =
      previous.submaps.size() > states.size() || LeftTheSite(previous, georeferences);
  for (size_t i = 0; i < states.size() && !some_changed; ++i) {
    if (i >= previous.submaps.size()) {
      AddToComponent(*states[i], &components[states[i]->component]);
    } else if (states[i] != previous.submaps[i]) {
      some_changed = states[i]->component != previous.submaps[i]->component ||
                     states[i]->refined != previous.submaps[i]->refined;
    }
  }
  if (some_changed) {
    components.clear();
    for (const auto& state : states) AddToComponent(*state, &components[state->component]);
  }
  std::vector<ComponentState> result;
  for (auto& [id, component] : components) {
    const auto known = georeferences.find(id);
    component.georeference = known == georeferences.end() ? nullptr : known->second;
    if (IsInSite(component)) component.metric = component.gravity_aligned = true;
    result.push_back(component);
  }
  return result;
}

}  // namespace

Status MapFuserOptions::Validate() const {
  if (min_observations < 2 || !(max_relative_sigma > 0) || !(moved_translation_of_depth >= 0) ||
      !(moved_rotation_rad >= 0)) {
    return absl::InvalidArgumentError("fusion: limits out of range");
  }
  return absl::OkStatus();
}

void RestoreMap(const MapSnapshot& snapshot, MapAligner* aligner) {
  for (const auto& state : snapshot.submaps) {
    aligner->RestoreSubmap({state->refined, state->component, state->world_from_submap,
                            state->world_from_camera, state->camera});
  }
  for (const ComponentState& component : snapshot.components) {
    if (IsInSite(component)) {
      aligner->RestoreGeoreference(component.id, component.georeference->origin);
    }
  }
  for (const auto& state : snapshot.submaps) {
    for (const FusedLandmark& landmark : state->landmarks) {
      aligner->RestoreLandmark({landmark.point_in_world, landmark.sights});
    }
  }
  if (snapshot.closures != nullptr) {
    for (size_t i = 0; i < snapshot.closures->size(); ++i) {
      aligner->RestoreClosure(snapshot.closures->shared(i));
    }
  }
  if (snapshot.waiting_closures != nullptr) {
    for (size_t i = 0; i < snapshot.waiting_closures->size(); ++i) {
      aligner->RestoreWaitingClosure(snapshot.waiting_closures->shared(i));
    }
  }
}

std::optional<FusedLandmark> MapFuser::FuseLandmark(const MapModel& model, int index) const {
  const ModelLandmark& landmark = model.landmarks()[index];
  FusedLandmark fused;
  fused.point_in_world = landmark.point_in_world;
  int inliers = 0, redundant = 0;
  std::optional<Eigen::Vector3d> from_first_camera;
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
  for (const LandmarkSight& sight : landmark.sights) {
    const ModelSubmap& submap = model.submap(sight.submap);
    const int in_submap = MapModel::LandmarkIndex(*submap.refined, sight.track);
    const int before = inliers;
    for (const ModelSight& s : submap.sights[in_submap]) {
      if (!s.inlier) continue;
      const Rigid3& pose = submap.world_from_camera[s.keyframe];
      if (!from_first_camera) from_first_camera = landmark.point_in_world - pose.translation;
      AddInformation(pose, *submap.camera, landmark.point_in_world,
                     submap.refined->raw->keyframes[s.keyframe].observations[s.observation],
                     &information);
      ++inliers;
    }
    // Redundant keyframes see it as well, but the estimate owes them nothing.
    if (inliers > before) redundant += submap.refined->landmarks[in_submap].redundant_count;
  }
  if (inliers < options_.min_observations) return std::nullopt;
  fused.observation_count = inliers + redundant;
  // In units of the distance, whatever the length of the world's unit is.
  const double distance = from_first_camera->norm();
  const Eigen::LLT<Eigen::Matrix3d> factor(distance * distance * information);
  if (factor.info() != Eigen::Success) return std::nullopt;
  const Eigen::Matrix3d relative = factor.solve(Eigen::Matrix3d::Identity());
  const Eigen::Vector3d ray = *from_first_camera / distance;
  if (!(std::sqrt(ray.dot(relative * ray)) < options_.max_relative_sigma)) return std::nullopt;
  fused.covariance = Eigen::Matrix3d(0.5 * distance * distance * (relative + relative.transpose()));
  fused.sights = landmark.sights;
  fused.id = LandmarkIdOf(landmark.sights.front());
  return fused;
}

std::shared_ptr<const SubmapState> MapFuser::FuseSubmap(const MapAligner& aligner, SubmapId id,
                                                        const SubmapState* previous,
                                                        uint64_t version) const {
  const MapModel& model = aligner.model();
  const ModelSubmap& submap = model.submap(id);
  auto state = std::make_shared<SubmapState>();
  state->refined = submap.refined;
  state->component = submap.component;
  state->world_from_submap = submap.world_from_submap;
  state->covariance = aligner.Covariance(id);
  state->world_from_camera = submap.world_from_camera;
  state->camera = submap.camera;
  for (size_t i = 0; i < submap.landmarks.size(); ++i) {
    const ModelLandmark& landmark = model.landmarks()[submap.landmarks[i]];
    if (landmark.sights.front() != LandmarkSight{id, submap.refined->landmarks[i].track}) continue;
    std::optional<FusedLandmark> fused = FuseLandmark(model, submap.landmarks[i]);
    if (fused) state->landmarks.push_back(*std::move(fused));
  }
  state->landmarks.shrink_to_fit();
  state->moved_at_version = MovedAt(submap, model, previous, version);
  return state;
}

uint64_t MapFuser::MovedAt(const ModelSubmap& submap, const MapModel& model,
                           const SubmapState* previous, uint64_t version) const {
  if (previous == nullptr || previous->component != submap.component) return version;
  std::vector<double> depths;
  for (const int index : submap.landmarks) {
    depths.push_back(
        (model.landmarks()[index].point_in_world - submap.world_from_camera.front().translation)
            .norm());
  }
  double depth = 0;
  if (!depths.empty()) {
    std::nth_element(depths.begin(), depths.begin() + depths.size() / 2, depths.end());
    depth = depths[depths.size() / 2];
  }
  for (size_t k = 0; k < submap.world_from_camera.size(); ++k) {
    const Rigid3& before = previous->world_from_camera[k];
    const Rigid3& after = submap.world_from_camera[k];
    if ((before.translation - after.translation).norm() >
            options_.moved_translation_of_depth * depth ||
        before.rotation.angularDistance(after.rotation) > options_.moved_rotation_rad) {
      return version;
    }
  }
  return previous->moved_at_version;
}

std::shared_ptr<const SubmapState> MapFuser::MoveState(const MapAligner& aligner, SubmapId id,
                                                       const SubmapState& previous,
                                                       uint64_t version) const {
  const MapModel& model = aligner.model();
  const ModelSubmap& submap = model.submap(id);
  auto state = std::make_shared<SubmapState>(previous);
  state->component = submap.component;
  state->world_from_submap = submap.world_from_submap;
  state->covariance = aligner.Covariance(id);
  state->world_from_camera = submap.world_from_camera;
  state->camera = submap.camera;
  const Similarity3 change = submap.world_from_submap * previous.world_from_submap.Inverse();
  const Eigen::Matrix3d turn = change.scale * change.rotation.toRotationMatrix();
  for (FusedLandmark& landmark : state->landmarks) {
    const int index = MapModel::LandmarkIndex(*submap.refined, landmark.sights.front().track);
    landmark.point_in_world = model.landmarks()[submap.landmarks[index]].point_in_world;
    landmark.covariance = Eigen::Matrix3d(turn * landmark.covariance.Matrix() * turn.transpose());
  }
  state->moved_at_version = MovedAt(submap, model, &previous, version);
  return state;
}

std::shared_ptr<const SubmapState> MapFuser::FuseSomeLandmarks(
    const MapModel& model, SubmapId id, const SubmapState& previous,
    const std::set<TrackId>& tracks) const {
  const ModelSubmap& submap = model.submap(id);
  auto state = std::make_shared<SubmapState>(previous);
  std::vector<FusedLandmark>& landmarks = state->landmarks;
  for (const TrackId track : tracks) {
    const int index = MapModel::LandmarkIndex(*submap.refined, track);
    if (index < 0) continue;
    const LandmarkSight sight{id, track};
    std::optional<FusedLandmark> fused;
    if (model.landmarks()[submap.landmarks[index]].sights.front() == sight) {
      fused = FuseLandmark(model, submap.landmarks[index]);
    }
    const LandmarkId name = LandmarkIdOf(sight);
    auto place = std::lower_bound(
        landmarks.begin(), landmarks.end(), name,
        [](const FusedLandmark& landmark, LandmarkId other) { return landmark.id < other; });
    const bool known = place != landmarks.end() && place->id == name;
    if (known && fused) {
      *place = *std::move(fused);
    } else if (known) {
      landmarks.erase(place);
    } else if (fused) {
      landmarks.insert(place, *std::move(fused));
    }
  }
  landmarks.shrink_to_fit();
  return state;
}

std::shared_ptr<const MapSnapshot> MapFuser::Fuse(const MapSnapshot& previous,
                                                  MapAligner* aligner) const {
  const MapModel& model = aligner->model();
  std::set<SubmapId> touched = aligner->TakeTouched();
  const std::set<SubmapId> moved = aligner->TakeMoved();
  auto snapshot = std::make_shared<MapSnapshot>();
  snapshot->version = previous.version + 1;
  snapshot->submaps = previous.submaps;
  snapshot->closures = Shared(previous.closures, aligner->closures());
  snapshot->waiting_closures = Shared(previous.waiting_closures, aligner->waiting_closures());
  auto& states = snapshot->submaps;
  const auto place_of = [&](SubmapId id) {
    return std::lower_bound(
        states.begin(), states.end(), id,
        [](const auto& state, SubmapId other) { return state->refined->id < other; });
  };
  if (states.size() != model.submaps().size()) {
    for (auto it = model.submaps().rbegin(); it != model.submaps().rend(); ++it) {
      const auto place = place_of(it->first);
      if (place != states.end() && (*place)->refined->id == it->first) {
        if (states.size() == model.submaps().size()) break;
        continue;
      }
      states.insert(place, FuseSubmap(*aligner, it->first, nullptr, snapshot->version));
      touched.erase(it->first);
    }
  }
  for (const SubmapId id : moved) {
    if (touched.contains(id)) continue;
    auto& state = *place_of(id);
    state = MoveState(*aligner, id, *state, snapshot->version);
  }
  for (const SubmapId id : touched) {
    auto& state = *place_of(id);
    state = FuseSubmap(*aligner, id, state.get(), snapshot->version);
  }
  for (const auto& [id, tracks] : aligner->TakeTouchedLandmarks()) {
    if (touched.contains(id)) continue;
    auto& state = *place_of(id);
    state = FuseSomeLandmarks(model, id, *state, tracks);
  }
  snapshot->components = Components(previous, states, aligner->georeferences());
  return snapshot;
}

}  // namespace portolan
