#include "agent/landmarks/track_places.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <utility>

#include "common/base/keep_latest.h"

namespace portolan {

Status TrackPlacesOptions::Validate() const {
  if (max_tracks < 1 || min_views < 2 || max_searched < 0) {
    return absl::InvalidArgumentError(
        "track_places: max_tracks must be positive, min_views at least 2, max_searched at least 0");
  }
  if (!(min_parallax_rad > 0) || !(pixel_sigma_px > 0) || !(drift_sigma_px > 0) ||
      !(max_sigma_px > 0) || !(max_view_angle_rad > 0) || !(max_distance_factor > 1)) {
    return absl::InvalidArgumentError("track_places: a limit is out of range");
  }
  return absl::OkStatus();
}

// With p_old = R p_new + t: sums over the same rays in the new frame.
void TrackPlaces::Rebase(const Rigid3& old_from_new) {
  const Eigen::Matrix3d rotation = old_from_new.rotation.toRotationMatrix();
  const Eigen::Vector3d& shift = old_from_new.translation;
  const Rigid3 new_from_old = old_from_new.Inverse();
  for (auto& [id, track] : tracks_) {
    track.squares += shift.dot(track.projectors * shift) - 2 * shift.dot(track.moments);
    track.moments = rotation.transpose() * (track.moments - track.projectors * shift);
    track.projectors = rotation.transpose() * track.projectors * rotation;
    track.seen_from = new_from_old * track.seen_from;
    if (!track.point) continue;
    track.point->position = new_from_old * track.point->position;
    track.point->covariance = rotation.transpose() * track.point->covariance * rotation;
  }
}

void TrackPlaces::Rescale(double scale) {
  for (auto& [id, track] : tracks_) {
    track.moments *= scale;
    track.squares *= scale * scale;
    track.seen_from.translation *= scale;
    if (!track.point) continue;
    track.point->position *= scale;
    track.point->covariance *= scale * scale;
  }
}

std::vector<TrackId> TrackPlaces::AddKeyframe(const Rigid3& submap_from_camera,
                                              const std::vector<TrackedPoint>& points) {
  if (!options_.enabled) return {};
  std::vector<TrackId> slipped;
  ++keyframe_count_;
  const Eigen::Vector3d& origin = submap_from_camera.translation;
  for (const TrackedPoint& point : points) {
    const auto bearing = camera_.Unproject(point.pixel);
    if (!bearing) continue;
    const Eigen::Vector3d direction = submap_from_camera.rotation * *bearing;
    Track& track = tracks_[point.track];
    const Eigen::Matrix3d projector =
        Eigen::Matrix3d::Identity() - direction * direction.transpose();
    const Eigen::Vector3d moment = projector * origin;
    track.projectors += projector;
    track.moments += moment;
    track.squares += origin.dot(moment);
    ++track.views;
    track.seen_at = keyframe_count_;
    track.seen_from = submap_from_camera;
    bool misses = false;
    track.point = Triangulate(track, &misses);
    if (misses) slipped.push_back(point.track);
  }
  for (const TrackId& track : slipped) tracks_.erase(track);
  KeepLatest(options_.max_tracks, &Track::seen_at, &tracks_);
  return slipped;
}

std::optional<TrackPlaces::Point> TrackPlaces::Triangulate(const Track& track, bool* misses) const {
  if (track.views < options_.min_views) return std::nullopt;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(track.projectors);
  // The least eigenvalue is the sum of squared sines about the mean direction.
  const double parallax2 = eigen.eigenvalues()[0];
  if (!(parallax2 > options_.min_parallax_rad * options_.min_parallax_rad)) return std::nullopt;
  Point point;
  point.position =
      eigen.eigenvectors() *
      (eigen.eigenvectors().transpose() * track.moments).cwiseQuotient(eigen.eigenvalues());
  const double distance = (point.position - track.seen_from.translation).norm();
  const double sigma = options_.pixel_sigma_px / camera_.mean_focal_px() * distance;
  // Rays that miss each other belong to different points.
  const double miss2 = track.squares - track.moments.dot(point.position);
  constexpr double kMaxMissSigmas = 3;
  *misses = !(miss2 < kMaxMissSigmas * kMaxMissSigmas * sigma * sigma * track.views);
  if (*misses) return std::nullopt;
  point.covariance = sigma * sigma * eigen.eigenvectors() *
                     eigen.eigenvalues().cwiseInverse().asDiagonal() *
                     eigen.eigenvectors().transpose();
  return point;
}

std::optional<TrackPlaces::Prediction> TrackPlaces::Predict(
    const Point& point, const Rigid3& camera_from_submap) const {
  Prediction prediction;
  const auto pixel =
      camera_.Project(camera_from_submap * point.position, &prediction.d_pixel_d_point_in_camera);
  if (!pixel) return std::nullopt;
  prediction.pixel = *pixel;
  const Matrix23d d_point =
      prediction.d_pixel_d_point_in_camera * camera_from_submap.rotation.toRotationMatrix();
  prediction.covariance_px2 = d_point * point.covariance * d_point.transpose();
  prediction.covariance_px2.diagonal().array() += options_.drift_sigma_px * options_.drift_sigma_px;
  const double limit = options_.max_sigma_px * options_.max_sigma_px;
  if (!(prediction.covariance_px2.diagonal().maxCoeff() < limit)) return std::nullopt;
  return prediction;
}

std::vector<TrackPrediction> TrackPlaces::PredictLive(const Rigid3& submap_from_camera) const {
  if (!options_.enabled) return {};
  const Rigid3 camera_from_submap = submap_from_camera.Inverse();
  std::vector<TrackPrediction> predictions;
  for (const auto& [id, track] : tracks_) {
    if (track.seen_at != keyframe_count_ || !track.point) continue;
    const auto prediction = Predict(*track.point, camera_from_submap);
    if (!prediction) continue;
    predictions.push_back({id, prediction->pixel, prediction->covariance_px2});
  }
  return predictions;
}

std::vector<SearchRegion> TrackPlaces::ExpectLost(const Rigid3& submap_from_camera,
                                                  const std::vector<TrackId>& lost) const {
  const Rigid3 camera_from_submap = submap_from_camera.Inverse();
  std::vector<std::map<TrackId, Track>::const_iterator> known;
  for (const TrackId id : lost) {
    const auto track = tracks_.find(id);
    if (track != tracks_.end() && track->second.point) known.push_back(track);
  }
  std::stable_sort(known.begin(), known.end(), [](const auto& a, const auto& b) {
    return a->second.seen_at > b->second.seen_at;
  });
  std::vector<SearchRegion> regions;
  for (const auto& track : known) {
    if (static_cast<int>(regions.size()) == options_.max_searched) break;
    auto region = Expect(track->second, submap_from_camera, camera_from_submap);
    if (!region) continue;
    region->track = track->first;
    regions.push_back(*region);
  }
  return regions;
}

std::optional<SearchRegion> TrackPlaces::Expect(const Track& track,
                                                const Rigid3& submap_from_camera,
                                                const Rigid3& camera_from_submap) const {
  const std::optional<Point>& point = track.point;
  const Eigen::Vector3d now = point->position - submap_from_camera.translation;
  const Eigen::Vector3d then = point->position - track.seen_from.translation;
  const double factor = now.norm() / then.norm();
  if (!(factor < options_.max_distance_factor) || !(factor * options_.max_distance_factor > 1)) {
    return std::nullopt;
  }
  if (!(now.dot(then) > std::cos(options_.max_view_angle_rad) * now.norm() * then.norm())) {
    return std::nullopt;
  }
  const auto prediction = Predict(*point, camera_from_submap);
  if (!prediction || !camera_.IsInImage(prediction->pixel)) return std::nullopt;
  // The image about the point, were it on a plane across the ray of then.
  const Eigen::Vector3d then_in_camera = track.seen_from.Inverse() * point->position;
  Matrix23d d_pixel_then;
  if (!camera_.Project(then_in_camera, &d_pixel_then)) return std::nullopt;
  const Eigen::Vector3d ray = then_in_camera.normalized();
  const Eigen::Vector3d u = ray.unitOrthogonal();
  Eigen::Matrix<double, 3, 2> plane;
  plane << u, ray.cross(u);
  const Eigen::Matrix3d now_from_then =
      (camera_from_submap.rotation * track.seen_from.rotation).toRotationMatrix();
  const Eigen::Matrix2d then_from_plane = d_pixel_then * plane;
  if (!(std::abs(then_from_plane.determinant()) > 0)) return std::nullopt;
  SearchRegion region;
  region.pixel = prediction->pixel;
  region.covariance_px2 = prediction->covariance_px2;
  region.warp =
      prediction->d_pixel_d_point_in_camera * now_from_then * plane * then_from_plane.inverse();
  return region;
}

}  // namespace portolan
