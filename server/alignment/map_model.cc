#include "server/alignment/map_model.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numeric>

#include "common/base/check.h"
#include "server/refinement/submap_refiner.h"

namespace portolan {

Status MapModelOptions::Validate() const {
  if (!(max_conflict_px > 0) || !(agreeing_chi2 > 0)) {
    return absl::InvalidArgumentError("map model: limits must be positive");
  }
  return absl::OkStatus();
}

SightTable::SightTable(size_t landmark_count, const std::vector<ModelSight>& sights,
                       const std::vector<int>& landmark_of)
    : first_(landmark_count + 1, 0), sights_(sights.size()) {
  for (const int landmark : landmark_of) ++first_[landmark + 1];
  std::partial_sum(first_.begin(), first_.end(), first_.begin());
  std::vector<uint32_t> next = first_;
  for (size_t i = 0; i < sights.size(); ++i) sights_[next[landmark_of[i]]++] = sights[i];
}

int MapModel::LandmarkIndex(const RefinedSubmap& refined, TrackId track) {
  const RefinedLandmark* landmark = FindLandmark(refined, track);
  return landmark == nullptr ? -1 : static_cast<int>(landmark - refined.landmarks.data());
}

std::vector<SubmapId> MapModel::SubmapsOf(ComponentId component) const {
  const auto members = members_.find(component);
  if (members == members_.end()) return {};
  return {members->second.begin(), members->second.end()};
}

size_t MapModel::SizeOf(ComponentId component) const {
  const auto members = members_.find(component);
  return members == members_.end() ? 0 : members->second.size();
}

void MapModel::SetComponent(SubmapId id, ComponentId component) {
  ModelSubmap& submap = submaps_.at(id);
  const auto members = members_.find(submap.component);
  if (members != members_.end() && members->second.erase(id) > 0 && members->second.empty()) {
    members_.erase(members);
  }
  submap.component = component;
  members_[component].insert(id);
}

ComponentId MapModel::MainComponentOf(SubmapId id) const {
  const SubmapKey& key = submaps_.at(id).refined->raw->key;
  std::map<ComponentId, size_t> sizes;
  for (const SubmapId member : sessions_.at({key.agent, key.session}).submaps) {
    ++sizes[submaps_.at(member).component];
  }
  return std::max_element(sizes.begin(), sizes.end(),
                          [](const auto& a, const auto& b) { return a.second < b.second; })
      ->first;
}

MapModel::Session& MapModel::SessionOf(const RefinedSubmap& refined) {
  return sessions_[{refined.raw->key.agent, refined.raw->key.session}];
}

void MapModel::SetCameraModel(SubmapId id, std::shared_ptr<const CameraModel> camera) {
  Session& session = SessionOf(*submaps_.at(id).refined);
  for (const SubmapId member : session.submaps) submaps_.at(member).camera = camera;
  session.camera = std::move(camera);
}

ModelSubmap& MapModel::Insert(std::shared_ptr<const RefinedSubmap> refined,
                              const std::optional<SubmapRelation>& link) {
  PORTOLAN_CHECK(!Contains(refined->id));
  const SubmapId id = refined->id;
  ModelSubmap& submap = submaps_[id];
  submap.refined = std::move(refined);
  Session& session = SessionOf(*submap.refined);
  if (session.camera == nullptr) session.camera = submap.refined->camera;
  session.submaps.push_back(id);
  submap.camera = session.camera;
  SetComponent(id, ComponentId(id.value()));
  submap.link = link;
  if (link) submaps_.at(link->a).successor = id;
  CollectSights(&submap);
  return submap;
}

void MapModel::CollectSights(ModelSubmap* submap) const {
  const RefinedSubmap& refined = *submap->refined;
  submap->landmarks.assign(refined.landmarks.size(), -1);
  std::vector<ModelSight> sights;
  std::vector<int> landmark_of;
  const auto agreeing = AgreeingObservations(refined, options_.agreeing_chi2);
  const ModelSubmap* predecessor = submap->link ? &submaps_.at(submap->link->a) : nullptr;
  for (size_t k = 0; k < refined.raw->keyframes.size(); ++k) {
    if (IsRedundant(refined, static_cast<int>(k))) continue;
    const std::vector<Observation>& observations = refined.raw->keyframes[k].observations;
    for (size_t i = 0; i < observations.size(); ++i) {
      const TrackId track = observations[i].track;
      const int landmark = LandmarkIndex(refined, track);
      if (landmark < 0) continue;
      if (k == 0 && predecessor != nullptr) {
        const int shared = LandmarkIndex(*predecessor->refined, track);
        const int last = static_cast<int>(predecessor->refined->raw->keyframes.size()) - 1;
        if (shared >= 0 && !predecessor->sights[shared].empty() &&
            predecessor->sights[shared].back().keyframe == last) {
          continue;
        }
      }
      ModelSight sight;
      sight.observation = static_cast<uint16_t>(i);
      sight.keyframe = static_cast<uint16_t>(k);
      sight.inlier = agreeing[k][i];
      sights.push_back(sight);
      landmark_of.push_back(landmark);
    }
  }
  submap->sights = SightTable(refined.landmarks.size(), sights, landmark_of);
}

void MapModel::Add(std::shared_ptr<const RefinedSubmap> refined,
                   const std::optional<SubmapRelation>& link) {
  const SubmapId id = refined->id;
  ModelSubmap& submap = Insert(std::move(refined), link);
  if (link) {
    const ModelSubmap& predecessor = submaps_.at(link->a);
    SetComponent(id, predecessor.component);
    submap.world_from_submap =
        Similarity3::FromRigid(predecessor.world_from_camera.back(),
                               predecessor.world_from_submap.scale * link->a_from_b.scale);
  }
  for (const Rigid3& submap_from_camera : submap.refined->submap_from_camera) {
    submap.world_from_camera.push_back(submap.world_from_submap * submap_from_camera);
  }
  AttachLandmarks(id);
}

void MapModel::Restore(const PlacedSubmap& placed, const std::optional<SubmapRelation>& link) {
  ModelSubmap& submap = Insert(placed.refined, link);
  SetComponent(placed.refined->id, placed.component);
  submap.world_from_submap = placed.world_from_submap;
  submap.world_from_camera = placed.world_from_camera;
  // Components of one session may have been adjusted with different lenses.
  if (placed.camera != nullptr && placed.camera->intrinsics() != submap.camera->intrinsics() &&
      MainComponentOf(placed.refined->id) == placed.component) {
    SetCameraModel(placed.refined->id, placed.camera);
  }
  AttachLandmarks(placed.refined->id);
}

void MapModel::RestoreLandmark(const ModelLandmark& known) {
  const auto index_of = [this](const LandmarkSight& sight) {
    if (!Contains(sight.submap)) return -1;
    const ModelSubmap& submap = submaps_.at(sight.submap);
    const int index = LandmarkIndex(*submap.refined, sight.track);
    return index < 0 ? -1 : submap.landmarks[index];
  };
  int kept = -1;
  for (const LandmarkSight& sight : known.sights) {
    const int index = index_of(sight);
    if (index < 0 || index == kept) continue;
    if (kept < 0) {
      kept = index;
    } else {
      Unite(kept, index);
    }
  }
  if (kept >= 0) landmarks_[kept].point_in_world = known.point_in_world;
}

// Tracks that the predecessor has are its landmarks; the others are new.
void MapModel::AttachLandmarks(SubmapId id) {
  ModelSubmap& submap = submaps_.at(id);
  const ModelSubmap* predecessor = submap.link ? &submaps_.at(submap.link->a) : nullptr;
  for (size_t i = 0; i < submap.refined->landmarks.size(); ++i) {
    const RefinedLandmark& refined = submap.refined->landmarks[i];
    int index = -1;
    if (predecessor != nullptr) {
      const int shared = LandmarkIndex(*predecessor->refined, refined.track);
      if (shared >= 0) index = predecessor->landmarks[shared];
    }
    if (index < 0) {
      index = NewLandmark();
      landmarks_[index].point_in_world = submap.world_from_submap * refined.point_in_submap;
    }
    submap.landmarks[i] = index;
    const LandmarkSight sight{id, refined.track};
    std::vector<LandmarkSight>& sights = landmarks_[index].sights;
    sights.insert(std::lower_bound(sights.begin(), sights.end(), sight), sight);
  }
}

int MapModel::NewLandmark() {
  if (free_landmarks_.empty()) {
    landmarks_.emplace_back();
    return static_cast<int>(landmarks_.size()) - 1;
  }
  const int index = free_landmarks_.back();
  free_landmarks_.pop_back();
  landmarks_[index] = {};
  return index;
}

void MapModel::MoveComponent(ComponentId from, ComponentId to, const Similarity3& to_from_from) {
  for (const SubmapId id : SubmapsOf(from)) {
    ModelSubmap& submap = submaps_.at(id);
    SetComponent(id, to);
    submap.world_from_submap = to_from_from * submap.world_from_submap;
    for (Rigid3& camera : submap.world_from_camera) camera = to_from_from * camera;
    for (size_t i = 0; i < submap.landmarks.size(); ++i) {
      ModelLandmark& landmark = landmarks_[submap.landmarks[i]];
      const LandmarkSight sight{id, submap.refined->landmarks[i].track};
      if (landmark.sights.front() != sight) continue;
      landmark.point_in_world = to_from_from * landmark.point_in_world;
    }
  }
}

void MapModel::MoveSubmap(SubmapId id, const Similarity3& world_from_submap) {
  ModelSubmap& submap = submaps_.at(id);
  const Similarity3 change = world_from_submap * submap.world_from_submap.Inverse();
  submap.world_from_submap = world_from_submap;
  for (Rigid3& camera : submap.world_from_camera) camera = change * camera;
  for (size_t i = 0; i < submap.landmarks.size(); ++i) {
    ModelLandmark& landmark = landmarks_[submap.landmarks[i]];
    const LandmarkSight sight{id, submap.refined->landmarks[i].track};
    if (landmark.sights.front() == sight)
      landmark.point_in_world = change * landmark.point_in_world;
  }
  // The shared keyframe is one camera; it stays where the successor, whose frame it is, has it.
  if (submap.successor) {
    submap.world_from_camera.back() = submaps_.at(*submap.successor).world_from_camera.front();
  }
  if (submap.link) {
    submaps_.at(submap.link->a).world_from_camera.back() = submap.world_from_camera.front();
  }
}

void MapModel::NamePart(const std::vector<SubmapId>& part, ComponentId name) {
  for (const SubmapId id : part) SetComponent(id, name);
}

void MapModel::SeparateLandmarks(const std::vector<SubmapId>& submaps) {
  std::map<LandmarkSight, Eigen::Vector3d> positions;
  for (const SubmapId id : submaps) {
    ModelSubmap& submap = submaps_.at(id);
    for (size_t i = 0; i < submap.landmarks.size(); ++i) {
      const LandmarkSight sight{id, submap.refined->landmarks[i].track};
      ModelLandmark& landmark = landmarks_[submap.landmarks[i]];
      positions[sight] = landmark.point_in_world;
      std::erase(landmark.sights, sight);
      if (landmark.sights.empty()) free_landmarks_.push_back(submap.landmarks[i]);
      submap.landmarks[i] = -1;
    }
  }
  for (const SubmapId id : submaps) AttachLandmarks(id);
  for (const SubmapId id : submaps) {
    ModelSubmap& submap = submaps_.at(id);
    for (size_t i = 0; i < submap.landmarks.size(); ++i) {
      const LandmarkSight sight{id, submap.refined->landmarks[i].track};
      ModelLandmark& landmark = landmarks_[submap.landmarks[i]];
      if (landmark.sights.front() == sight) landmark.point_in_world = positions.at(sight);
    }
  }
}

void MapModel::SeparateLandmark(int index) {
  const ModelLandmark whole = landmarks_[index];
  landmarks_[index].sights.clear();
  bool is_reused = false;
  for (const LandmarkSight& sight : whole.sights) {
    ModelSubmap& submap = submaps_.at(sight.submap);
    int part = -1;
    if (submap.link) {
      const ModelSubmap& predecessor = submaps_.at(submap.link->a);
      const int shared = LandmarkIndex(*predecessor.refined, sight.track);
      if (shared >= 0) part = predecessor.landmarks[shared];
    }
    if (part < 0) {
      part = is_reused ? NewLandmark() : index;
      is_reused = true;
      landmarks_[part].point_in_world = whole.point_in_world;
    }
    submap.landmarks[LandmarkIndex(*submap.refined, sight.track)] = part;
    std::vector<LandmarkSight>& sights = landmarks_[part].sights;
    sights.insert(std::lower_bound(sights.begin(), sights.end(), sight), sight);
  }
}

bool MapModel::UniteLandmarks(const LandmarkSight& a, const LandmarkSight& b) {
  const ModelSubmap& submap_a = submaps_.at(a.submap);
  const ModelSubmap& submap_b = submaps_.at(b.submap);
  const int in_a = LandmarkIndex(*submap_a.refined, a.track);
  const int in_b = LandmarkIndex(*submap_b.refined, b.track);
  if (in_a < 0 || in_b < 0) return false;
  int into = submap_a.landmarks[in_a];
  int from = submap_b.landmarks[in_b];
  if (into == from) return true;
  if (Conflict(landmarks_[into], landmarks_[from])) return false;
  // The one with the older sight keeps its place and its id.
  if (landmarks_[from].sights.front() < landmarks_[into].sights.front()) std::swap(into, from);
  Unite(into, from);
  return true;
}

void MapModel::Unite(int into, int from) {
  for (const LandmarkSight& sight : landmarks_[from].sights) {
    ModelSubmap& submap = submaps_.at(sight.submap);
    submap.landmarks[LandmarkIndex(*submap.refined, sight.track)] = into;
  }
  std::vector<LandmarkSight> sights;
  std::merge(landmarks_[into].sights.begin(), landmarks_[into].sights.end(),
             landmarks_[from].sights.begin(), landmarks_[from].sights.end(),
             std::back_inserter(sights));
  landmarks_[into].sights = std::move(sights);
  landmarks_[from] = {};
  free_landmarks_.push_back(from);
}

bool MapModel::Conflict(const ModelLandmark& a, const ModelLandmark& b) const {
  std::map<std::pair<SubmapId, int>, Eigen::Vector2f> pixels;
  const auto visit = [this](const ModelLandmark& landmark, const auto& function) {
    for (const LandmarkSight& sight : landmark.sights) {
      const ModelSubmap& submap = submaps_.at(sight.submap);
      for (const ModelSight& s : submap.sights[LandmarkIndex(*submap.refined, sight.track)]) {
        const Keyframe& keyframe = submap.refined->raw->keyframes[s.keyframe];
        function(CameraOf(sight.submap, s.keyframe), keyframe.observations[s.observation].pixel);
      }
    }
  };
  visit(a, [&](const auto& camera, const Eigen::Vector2f& pixel) { pixels[camera] = pixel; });
  bool conflict = false;
  visit(b, [&](const auto& camera, const Eigen::Vector2f& pixel) {
    const auto it = pixels.find(camera);
    if (it == pixels.end()) return;
    conflict = conflict || (it->second - pixel).norm() > options_.max_conflict_px;
  });
  return conflict;
}

std::pair<SubmapId, int> MapModel::CameraOf(SubmapId id, int keyframe) const {
  const ModelSubmap& submap = submaps_.at(id);
  if (keyframe > 0 || !submap.link) return {id, keyframe};
  const SubmapId predecessor = submap.link->a;
  return {predecessor, static_cast<int>(submaps_.at(predecessor).world_from_camera.size()) - 1};
}

void MapModel::SetCamera(SubmapId id, int keyframe, const Rigid3& world_from_camera) {
  ModelSubmap& submap = submaps_.at(id);
  submap.world_from_camera[keyframe] = world_from_camera;
  const bool last = keyframe + 1 == static_cast<int>(submap.world_from_camera.size());
  if (last && submap.successor) {
    submaps_.at(*submap.successor).world_from_camera.front() = world_from_camera;
  }
}

void MapModel::CarryRedundantKeyframes(SubmapId id) {
  ModelSubmap& submap = submaps_.at(id);
  const RefinedSubmap& refined = *submap.refined;
  const std::vector<Rigid3>& before = refined.submap_from_camera;
  const double scale = submap.world_from_submap.scale;
  for (const int keyframe : refined.redundant_keyframes) {
    const auto carried_by = [&](int neighbour) {
      Rigid3 step = before[neighbour].Inverse() * before[keyframe];
      step.translation *= scale;
      return submap.world_from_camera[neighbour] * step;
    };
    const int a = EssentialKeyframeBefore(refined, keyframe);
    const int b = EssentialKeyframeBehind(refined, keyframe);
    double way = 0, whole = 0;
    for (int k = a; k < b; ++k) {
      whole += (before[k + 1].translation - before[k].translation).norm();
      if (k < keyframe) way = whole;
    }
    const double part = whole > 0 ? way / whole : 0.5;
    const Rigid3 by_a = carried_by(a);
    const Rigid3 by_b = carried_by(b);
    submap.world_from_camera[keyframe] = {by_a.rotation.slerp(part, by_b.rotation).normalized(),
                                          (1 - part) * by_a.translation + part * by_b.translation};
  }
}

void MapModel::FitSubmapToCameras(SubmapId id) {
  ModelSubmap& submap = submaps_.at(id);
  const Rigid3& first = submap.world_from_camera.front();
  std::vector<double> ratios;
  for (size_t i = 0; i < submap.landmarks.size(); ++i) {
    const RefinedLandmark& refined = submap.refined->landmarks[i];
    const double distance = refined.point_in_submap.norm();
    // Only landmarks whose depth is known; the others' ratio is arbitrary.
    const double variance = refined.covariance.SquareOf(refined.point_in_submap);
    if (!(variance < 0.01 * std::pow(distance, 4))) continue;
    ratios.push_back((landmarks_[submap.landmarks[i]].point_in_world - first.translation).norm() /
                     distance);
  }
  double scale = submap.world_from_submap.scale;
  if (!ratios.empty()) {
    std::nth_element(ratios.begin(), ratios.begin() + ratios.size() / 2, ratios.end());
    scale = ratios[ratios.size() / 2];
  }
  submap.world_from_submap = Similarity3::FromRigid(first, scale);
}

}  // namespace portolan
