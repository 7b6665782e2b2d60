#include "agent/revisit/landmark_memory.h"

#include <Eigen/LU>
#include <algorithm>
#include <utility>

namespace portolan {
namespace {

// Sights of one track agree no better than so: what the camera model and the poses leave.
constexpr double kMinSigmaPx = 1.0;

}  // namespace

Status LandmarkMemoryOptions::Validate() const {
  PORTOLAN_RETURN_IF_ERROR(triangulation.Validate());
  if (max_submaps < 1 || min_sights < 2) {
    return absl::InvalidArgumentError("revisit.memory: a limit is out of range");
  }
  return absl::OkStatus();
}

void LandmarkMemory::AddSubmap(const Submap& submap) {
  std::map<TrackId, Track> tracks;
  for (int i = 0; i < static_cast<int>(submap.keyframes.size()); ++i) {
    for (const Feature& feature : submap.keyframes[i].features) {
      if (!feature.track) continue;
      Track& track = tracks[*feature.track];
      track.described_keyframe = i;
      track.descriptors.push_back(feature.descriptor);
    }
  }
  for (int i = 0; i < static_cast<int>(submap.keyframes.size()); ++i) {
    for (const Observation& observation : submap.keyframes[i].observations) {
      const auto track = tracks.find(observation.track);
      if (track != tracks.end()) track->second.sights.emplace_back(i, observation);
    }
  }
  OwnSubmap own;
  for (auto& [id, track] : tracks) {
    if (static_cast<int>(track.sights.size()) >= options_.min_sights) {
      own.tracks.push_back(std::move(track));
    }
  }
  own_[submap.key.sequence_number] = std::move(own);
  while (static_cast<int>(own_.size()) > options_.max_submaps) {
    groups_.erase(own_.begin()->first);
    own_.erase(own_.begin());
  }
}

void LandmarkMemory::Place(uint32_t sequence_number, ComponentId component, double scale,
                           std::span<const CorrectedKeyframe> keyframes) {
  const auto own = own_.find(sequence_number);
  if (own == own_.end()) return;
  Group& group = groups_[sequence_number];
  group.component = component;
  if (!own->second.tracks.empty()) Triangulate(scale, keyframes, &own->second, &group);
  for (size_t i = 0; i < group.landmarks.size(); ++i) {
    const Anchored& anchored = own->second.anchored[i];
    const Rigid3& pose = keyframes[anchored.keyframe].world_from_camera;
    const Eigen::Matrix3d rotation = pose.rotation.toRotationMatrix();
    group.landmarks[i].point_in_world = pose * (scale * anchored.point_in_camera);
    group.landmarks[i].covariance =
        scale * scale * rotation * anchored.covariance * rotation.transpose();
    group.landmarks[i].seen_from_in_world = pose.translation;
  }
}

void LandmarkMemory::Triangulate(double scale, std::span<const CorrectedKeyframe> keyframes,
                                 OwnSubmap* submap, Group* group) const {
  std::vector<TrackSight> rays;
  for (Track& track : std::exchange(submap->tracks, {})) {
    rays.clear();
    for (const auto& [keyframe, observation] : track.sights) {
      if (keyframe >= static_cast<int>(keyframes.size())) continue;
      rays.push_back({{keyframes[keyframe].world_from_camera, &camera_},
                      observation.pixel.cast<double>(),
                      std::max<double>(observation.sigma_px, kMinSigmaPx)});
    }
    if (rays.size() < 2) continue;
    const auto point = TriangulateTrack(options_.triangulation, rays, std::nullopt, scale);
    if (!point || point->inlier_count < options_.min_sights) continue;
    Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
    for (size_t i = 0; i < rays.size(); ++i) {
      if (!point->inliers[i]) continue;
      const Rigid3 camera_from_world = rays[i].camera.world_from_camera.Inverse();
      Matrix23d d_point;
      if (!camera_.Project(camera_from_world * point->point_in_world, &d_point)) continue;
      d_point = d_point * camera_from_world.rotation.toRotationMatrix() / rays[i].sigma_px;
      information += d_point.transpose() * d_point;
    }
    const Rigid3 camera_from_world =
        keyframes[track.described_keyframe].world_from_camera.Inverse();
    const Eigen::Vector3d point_in_camera = camera_from_world * point->point_in_world;
    // A depth that is not known at all.
    information += Eigen::Matrix3d::Identity() / point_in_camera.squaredNorm();
    const Eigen::Matrix3d rotation = camera_from_world.rotation.toRotationMatrix();
    submap->anchored.push_back(
        {track.described_keyframe, point_in_camera / scale,
         rotation * information.inverse() * rotation.transpose() / (scale * scale)});
    group->landmarks.push_back({.descriptors = std::move(track.descriptors)});
  }
}

std::optional<Eigen::Vector3d> LandmarkMemory::PositionOf(const KnownLandmarkId& id) const {
  const auto group = groups_.find(id.group);
  if (group == groups_.end() || id.index >= group->second.landmarks.size()) return std::nullopt;
  return group->second.landmarks[id.index].point_in_world;
}

}  // namespace portolan
