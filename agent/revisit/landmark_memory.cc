#include "agent/revisit/landmark_memory.h"

#include <Eigen/LU>
#include <algorithm>
#include <utility>

namespace portolan {
namespace {

// The sights of one track agree no better than so: what poses and camera model leave.
constexpr double kMinSigmaPx = 0.5;

}  // namespace

Status LandmarkMemoryOptions::Validate() const {
  PORTOLAN_RETURN_IF_ERROR(triangulation.Validate());
  if (max_submaps < 1 || max_offered_views < 1 || max_offered_landmarks < 1 || min_sights < 2) {
    return absl::InvalidArgumentError("revisit.memory: a limit is out of range");
  }
  return absl::OkStatus();
}

void LandmarkMemory::AddSubmap(const Submap& submap) {
  std::map<TrackId, Track> tracks;
  const int keyframes = static_cast<int>(submap.keyframes.size());
  for (int i = 0; i < keyframes; ++i) {
    for (const Feature& feature : submap.keyframes[i].features) {
      if (!feature.track) continue;
      Track& track = tracks[*feature.track];
      track.described_keyframe = i;
      track.descriptors.push_back(feature.descriptor);
    }
  }
  for (int i = 0; i < keyframes; ++i) {
    for (const Observation& observation : submap.keyframes[i].observations) {
      const auto track = tracks.find(observation.track);
      if (track != tracks.end()) track->second.sights.emplace_back(i, observation);
    }
  }
  OwnSubmap& own = own_[submap.key.sequence_number] = {};
  for (auto& [id, track] : tracks) {
    if (static_cast<int>(track.sights.size()) < options_.min_sights) continue;
    own.tracks.push_back(std::move(track));
  }
  if (static_cast<int>(own_.size()) <= options_.max_submaps) return;
  groups_.erase({false, own_.begin()->first});
  own_.erase(own_.begin());
}

void LandmarkMemory::Place(uint32_t sequence_number, ComponentId component, double scale,
                           std::span<const CorrectedKeyframe> keyframes) {
  const auto own = own_.find(sequence_number);
  if (own == own_.end() || keyframes.empty()) return;
  KnownGroup& group = groups_[{false, sequence_number}];
  group.component = component;
  Triangulate(scale, keyframes, &own->second, &group);
  for (size_t i = 0; i < group.landmarks.size(); ++i) {
    const Anchored& anchored = own->second.anchored[i];
    Move(anchored, keyframes[anchored.keyframe].world_from_camera, scale, &group.landmarks[i]);
  }
}

void LandmarkMemory::Move(const Anchored& anchored, const Rigid3& world_from_camera, double scale,
                          KnownLandmark* landmark) {
  const Eigen::Matrix3d rotation = world_from_camera.rotation.toRotationMatrix();
  landmark->point_in_world = world_from_camera * (scale * anchored.point_in_camera);
  landmark->covariance = scale * scale * rotation * anchored.covariance * rotation.transpose();
  landmark->seen_from_in_world = world_from_camera.translation;
}

void LandmarkMemory::Triangulate(double scale, std::span<const CorrectedKeyframe> keyframes,
                                 OwnSubmap* submap, KnownGroup* group) const {
  for (Track& track : std::exchange(submap->tracks, {})) {
    const std::optional<Anchored> anchored = AnchorOf(track, scale, keyframes);
    if (!anchored) continue;
    submap->anchored.push_back(*anchored);
    group->landmarks.emplace_back().descriptors = std::move(track.descriptors);
  }
}

std::optional<LandmarkMemory::Anchored> LandmarkMemory::AnchorOf(
    const Track& track, double scale, std::span<const CorrectedKeyframe> keyframes) const {
  std::vector<TrackSight> rays;
  for (const auto& [keyframe, observation] : track.sights) {
    rays.push_back({{keyframes[keyframe].world_from_camera, &camera_},
                    observation.pixel.cast<double>(),
                    std::max<double>(observation.sigma_px, kMinSigmaPx)});
  }
  const auto point = TriangulateTrack(options_.triangulation, rays, std::nullopt, scale);
  if (!point || point->inlier_count < options_.min_sights) return std::nullopt;
  const Rigid3 described_from_world =
      keyframes[track.described_keyframe].world_from_camera.Inverse();
  const Eigen::Vector3d point_in_camera = described_from_world * point->point_in_world;
  // In the world's axes; the distance is known to its own size at worst.
  Eigen::Matrix3d information = Eigen::Matrix3d::Identity() / point_in_camera.squaredNorm();
  for (size_t i = 0; i < rays.size(); ++i) {
    if (!point->inliers[i]) continue;
    const Rigid3 camera_from_world = rays[i].camera.world_from_camera.Inverse();
    Matrix23d d_pixel_d_point;
    if (!camera_.Project(camera_from_world * point->point_in_world, &d_pixel_d_point)) continue;
    d_pixel_d_point *= camera_from_world.rotation.toRotationMatrix() / rays[i].sigma_px;
    information += d_pixel_d_point.transpose() * d_pixel_d_point;
  }
  const Eigen::Matrix3d rotation = described_from_world.rotation.toRotationMatrix();
  return Anchored{track.described_keyframe, point_in_camera / scale,
                  rotation * information.inverse() * rotation.transpose() / (scale * scale)};
}

void LandmarkMemory::AddOffer(const LandmarkOffer& offer) {
  const KnownGroupId id{true, offer.view};
  if (!offered_.contains(id) && offer.first_index > 0) return;
  OfferedView& view = offered_[id];
  KnownGroup& group = groups_[id];
  view.received = ++received_;
  group.component = offer.component;
  if (offer.first_index == 0 && !offer.landmarks.empty()) {
    view.anchored.clear();
    group.landmarks.clear();
    group.filling = received_;
  }
  if (offer.first_index == group.landmarks.size()) {
    for (const OfferedLandmark& offered : offer.landmarks) {
      if (static_cast<int>(group.landmarks.size()) == options_.max_offered_landmarks) break;
      const Eigen::Vector3d& point = offered.point_in_camera;
      const Eigen::Matrix3d along = point * point.transpose() / point.squaredNorm();
      const double lateral = offered.lateral_sigma * point.norm();
      const double depth = offered.depth_sigma * point.norm();
      view.anchored.push_back(
          {0, point,
           lateral * lateral * (Eigen::Matrix3d::Identity() - along) + depth * depth * along});
      group.landmarks.emplace_back().descriptors.push_back(offered.descriptor);
    }
  }
  for (size_t i = 0; i < group.landmarks.size(); ++i) {
    Move(view.anchored[i], offer.world_from_camera.Rigid(), offer.world_from_camera.scale,
         &group.landmarks[i]);
  }
  if (static_cast<int>(offered_.size()) > options_.max_offered_views) ForgetOldestView();
}

void LandmarkMemory::ForgetOldestView() {
  const auto oldest = std::min_element(
      offered_.begin(), offered_.end(),
      [](const auto& a, const auto& b) { return a.second.received < b.second.received; });
  groups_.erase(oldest->first);
  offered_.erase(oldest);
}

std::optional<Eigen::Vector3d> LandmarkMemory::PositionOf(const KnownLandmarkId& id,
                                                          ComponentId component) const {
  const auto group = groups_.find(id.group);
  if (group == groups_.end() || group->second.component != component ||
      group->second.filling != id.filling || id.index >= group->second.landmarks.size()) {
    return std::nullopt;
  }
  return group->second.landmarks[id.index].point_in_world;
}

}  // namespace portolan
