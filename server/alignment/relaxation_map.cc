#include "server/alignment/relaxation_map.h"

#include <algorithm>
#include <span>
#include <utility>

namespace portolan {
namespace {

// Share of the landmarks that are taken for the submaps that see them.
constexpr double kConnectedShare = 0.75;

constexpr size_t kBodiesAtOnce = 50;

}  // namespace

RelaxationMap::RelaxationMap(const MapModel& model, const std::vector<SubmapId>& submaps)
    : taken_(model.landmarks().size(), 0) {
  AddBodies(model, submaps);
  place_at_start_.reserve(taken_.size());
  oldest_sight_at_start_.reserve(taken_.size());
  for (const ModelLandmark& landmark : model.landmarks()) {
    place_at_start_.push_back(landmark.point_in_world);
    oldest_sight_at_start_.push_back(landmark.sights.empty() ? LandmarkSight()
                                                             : landmark.sights.front());
  }
}

void RelaxationMap::AddBodies(const MapModel& model, const std::vector<SubmapId>& submaps) {
  for (const SubmapId id : submaps) body_of_.emplace(id, static_cast<int>(body_of_.size()));
  node_count_ = static_cast<int>(submaps.size());
  for (const SubmapId id : submaps) {
    const ModelSubmap& submap = model.submap(id);
    const auto successor = submap.successor ? body_of_.find(*submap.successor) : body_of_.end();
    const int start = static_cast<int>(bodies_.size());
    RelaxationBody body;
    body.id = id;
    body.world_from_submap = submap.world_from_submap;
    body.nodes = {start, successor == body_of_.end() ? node_count_++ : successor->second};
    body.last_keyframe = static_cast<int>(submap.world_from_camera.size()) - 1;
    body.camera = submap.camera;
    body.world_from_camera = submap.world_from_camera;
    body.moved.resize(submap.world_from_camera.size());
    bodies_.push_back(std::move(body));
  }
  UpdateFrames();
}

void RelaxationMap::UpdateFrames() {
  for (RelaxationBody& body : bodies_) body.submap_from_world = body.world_from_submap.Inverse();
  for (RelaxationBody& body : bodies_) {
    if (body.nodes[1] >= static_cast<int>(bodies_.size())) continue;
    body.from_end = (body.submap_from_world * bodies_[body.nodes[1]].world_from_submap).Adjoint();
  }
}

bool RelaxationMap::AddSomePoints(const MapModel& model, size_t max_landmarks) {
  const size_t end = std::min(next_body_ + kBodiesAtOnce, bodies_.size());
  for (; next_body_ < end; ++next_body_) {
    for (const int landmark : Selected(model, bodies_[next_body_], max_landmarks)) {
      if (static_cast<size_t>(landmark) >= taken_.size() ||
          model.landmarks()[landmark].sights.front() != oldest_sight_at_start_[landmark]) {
        continue;
      }
      if (std::exchange(taken_[landmark], 1) == 0) AddPoint(model, landmark);
    }
  }
  if (next_body_ < bodies_.size()) return false;
  std::vector<LandmarkSight>().swap(oldest_sight_at_start_);
  std::vector<Eigen::Vector3d>().swap(place_at_start_);
  std::vector<char>().swap(taken_);
  return true;
}

std::vector<int> RelaxationMap::Selected(const MapModel& model, const RelaxationBody& body,
                                         size_t max_landmarks) const {
  std::vector<int> landmarks = model.submap(body.id).landmarks;
  if (landmarks.size() <= max_landmarks) return landmarks;
  std::stable_sort(landmarks.begin(), landmarks.end(), [&model](int a, int b) {
    return model.landmarks()[a].sights.size() > model.landmarks()[b].sights.size();
  });
  const auto connected = static_cast<size_t>(kConnectedShare * static_cast<double>(max_landmarks));
  const size_t others = max_landmarks - connected;
  std::vector<int> selected(landmarks.begin(),
                            landmarks.begin() + static_cast<std::ptrdiff_t>(connected));
  for (size_t i = 0; i < others; ++i) {
    selected.push_back(landmarks[connected + i * (landmarks.size() - connected) / others]);
  }
  return selected;
}

void RelaxationMap::AddPoint(const MapModel& model, int landmark) {
  const ModelLandmark& known = model.landmarks()[landmark];
  RelaxationPoint point;
  point.landmark = landmark;
  point.in_world = point.at_start = place_at_start_[landmark];
  if (const auto owner = body_of_.find(known.sights.front().submap); owner != body_of_.end()) {
    point.owner = owner->second;
  }
  point.begin = sights_.size();
  for (const LandmarkSight& sight : known.sights) {
    const auto body = body_of_.find(sight.submap);
    if (body == body_of_.end()) continue;
    const ModelSubmap& submap = model.submap(sight.submap);
    const int in_submap = MapModel::LandmarkIndex(*submap.refined, sight.track);
    for (const ModelSight& one : submap.sights[in_submap]) {
      const Observation& observation =
          submap.refined->raw->keyframes[one.keyframe].observations[one.observation];
      sights_.push_back({body->second, one.keyframe, one.inlier, observation.pixel,
                         static_cast<float>(observation.sigma_px)});
    }
  }
  point.end = sights_.size();
  points_.push_back(point);
}

std::map<SubmapId, Similarity3> RelaxationMap::ApplyTo(MapModel* model) const {
  struct Place {
    int landmark = 0;
    Eigen::Vector3d before = Eigen::Vector3d::Zero();
    const Similarity3* moved = nullptr;
  };
  std::vector<Place> places;
  std::vector<std::vector<Rigid3>> cameras;
  for (const RelaxationBody& body : bodies_) {
    const ModelSubmap& submap = model->submap(body.id);
    for (size_t i = 0; i < submap.landmarks.size(); ++i) {
      const ModelLandmark& landmark = model->landmarks()[submap.landmarks[i]];
      const LandmarkSight own{body.id, submap.refined->landmarks[i].track};
      if (landmark.sights.front() != own) continue;
      const std::span<const ModelSight> sights = submap.sights[i];
      const int keyframe = sights.empty() ? 0 : sights[sights.size() / 2].keyframe;
      places.push_back({submap.landmarks[i], landmark.point_in_world, &body.moved[keyframe]});
    }
    cameras.push_back(submap.world_from_camera);
    for (size_t k = 0; k < cameras.back().size(); ++k) {
      cameras.back()[k] = body.moved[k] * cameras.back()[k];
    }
  }
  std::vector<int> point_of(model->landmarks().size(), -1);
  for (size_t i = 0; i < points_.size(); ++i) {
    const size_t landmark = points_[i].landmark;
    // One that was moved meanwhile goes on from there.
    if (model->landmarks()[landmark].point_in_world == points_[i].at_start) {
      point_of[landmark] = static_cast<int>(i);
    }
  }
  std::map<SubmapId, Similarity3> ends;
  for (const RelaxationBody& body : bodies_) {
    model->MoveSubmap(body.id, body.moved.front() * model->submap(body.id).world_from_submap);
    ends.emplace(body.id, body.moved.back());
  }
  for (size_t i = 0; i < bodies_.size(); ++i) {
    for (size_t k = 0; k < cameras[i].size(); ++k) {
      const auto [id, keyframe] = model->CameraOf(bodies_[i].id, static_cast<int>(k));
      if (id == bodies_[i].id) model->SetCamera(id, keyframe, cameras[i][k]);
    }
  }
  for (const Place& place : places) {
    if (point_of[place.landmark] < 0) {
      model->SetLandmark(place.landmark, *place.moved * place.before);
    }
  }
  for (size_t landmark = 0; landmark < point_of.size(); ++landmark) {
    if (point_of[landmark] < 0) continue;
    model->SetLandmark(static_cast<int>(landmark), points_[point_of[landmark]].in_world);
  }
  for (const RelaxationBody& body : bodies_) model->FitSubmapToCameras(body.id);
  return ends;
}

}  // namespace portolan
