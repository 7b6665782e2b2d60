#include "agent/revisit/landmark_matcher.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <map>

namespace portolan {
namespace {

// From coarse to fine: what is far off at first has little weight, but some.
constexpr double kSigmaFactors[] = {8, 3, 1};
// Descriptions of one point at several scales.
constexpr double kSamePointPx = 2.0;

class FeatureGrid {
 public:
  FeatureGrid(std::span<const Feature> features, const CameraModel& camera, double cell_px)
      : features_(features),
        cell_px_(cell_px),
        columns_(static_cast<int>(camera.width_px() / cell_px) + 1),
        rows_(static_cast<int>(camera.height_px() / cell_px) + 1),
        cells_(static_cast<size_t>(columns_) * rows_) {
    for (size_t i = 0; i < features.size(); ++i) {
      const int column = std::clamp(Cell(features[i].pixel.x()), 0, columns_ - 1);
      const int row = std::clamp(Cell(features[i].pixel.y()), 0, rows_ - 1);
      cells_[static_cast<size_t>(row) * columns_ + column].push_back(static_cast<int>(i));
    }
  }

  // Features within a cell's size of the pixel.
  template <typename Function>
  void ForEachNear(const Eigen::Vector2d& pixel, const Function& function) const {
    for (int row = std::max(0, Cell(pixel.y()) - 1); row <= std::min(rows_ - 1, Cell(pixel.y()) + 1);
         ++row) {
      for (int column = std::max(0, Cell(pixel.x()) - 1);
           column <= std::min(columns_ - 1, Cell(pixel.x()) + 1); ++column) {
        for (const int i : cells_[static_cast<size_t>(row) * columns_ + column]) {
          if ((features_[i].pixel.cast<double>() - pixel).squaredNorm() > cell_px_ * cell_px_) {
            continue;
          }
          function(i);
        }
      }
    }
  }

 private:
  int Cell(double coordinate) const { return static_cast<int>(std::floor(coordinate / cell_px_)); }

  std::span<const Feature> features_;
  const double cell_px_;
  const int columns_;
  const int rows_;
  std::vector<std::vector<int>> cells_;
};

}  // namespace

Status LandmarkMatcherOptions::Validate() const { return resection.Validate(); }

std::optional<Revisit> LandmarkMatcher::Match(const LandmarkMemory& memory, ComponentId component,
                                              uint64_t last_group, const Rigid3& world_from_camera,
                                              std::span<const Feature> features) const {
  const double radius = options_.search_radius_share * camera_.width_px();
  const FeatureGrid grid(features, camera_, radius);
  const Rigid3 camera_from_world = world_from_camera.Inverse();
  const Eigen::Matrix3d rotation = camera_from_world.rotation.toRotationMatrix();
  const double min_cosine = std::cos(options_.max_view_angle_rad);
  std::map<std::pair<float, float>, std::pair<int, KnownSight>> best_of_pixel;
  int in_view = 0;
  for (const auto& [id, group] : memory.groups()) {
    if (id > last_group || group.component != component) continue;
    for (uint32_t index = 0; index < group.landmarks.size(); ++index) {
      const KnownLandmark& landmark = group.landmarks[index];
      const Eigen::Vector3d point = camera_from_world * landmark.point_in_world;
      if (!(point.z() > 0)) continue;
      const Eigen::Vector3d then = landmark.point_in_world - landmark.seen_from_in_world;
      const Eigen::Vector3d now = landmark.point_in_world - world_from_camera.translation;
      const double factor = then.norm() / now.norm();
      if (factor > options_.max_distance_factor || factor * options_.max_distance_factor < 1 ||
          then.dot(now) < min_cosine * then.norm() * now.norm()) {
        continue;
      }
      Matrix23d d_point;
      const auto pixel = camera_.Project(point, &d_point);
      if (!pixel || !camera_.IsInImage(*pixel)) continue;
      d_point = d_point * rotation;
      const Eigen::Matrix2d covariance = d_point * landmark.covariance * d_point.transpose();
      const double variance =
          Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(covariance).eigenvalues()[1];
      if (!(variance < options_.max_landmark_sigma_px * options_.max_landmark_sigma_px)) continue;
      ++in_view;
      int best = 257, second = 257, best_index = -1;
      grid.ForEachNear(*pixel, [&](int i) {
        int distance = 257;
        for (const Descriptor& descriptor : landmark.descriptors) {
          distance = std::min(distance, HammingDistance(descriptor, features[i].descriptor));
        }
        const bool same = best_index >= 0 && (features[i].pixel - features[best_index].pixel).norm() <
                                                 kSamePointPx;
        if (distance < best) {
          if (!same) second = best;
          best = distance;
          best_index = i;
        } else if (!same) {
          second = std::min(second, distance);
        }
      });
      if (best > options_.max_distance_bits || second - best < options_.min_margin_bits) continue;
      const Feature& feature = features[best_index];
      const KnownSight sight{{id, index},
                             landmark.point_in_world,
                             feature.pixel.cast<double>(),
                             std::sqrt(options_.sigma_px * options_.sigma_px + variance)};
      const auto [at, is_new] = best_of_pixel.try_emplace(
          {feature.pixel.x(), feature.pixel.y()}, best, sight);
      if (!is_new && best < at->second.first) at->second = {best, sight};
    }
  }
  Revisit revisit;
  for (const auto& [pixel, match] : best_of_pixel) revisit.sights.push_back(match.second);
  const size_t matches = revisit.sights.size();
  const auto pose = Verify(world_from_camera, &revisit.sights);
  if (getenv("REVISIT_DEBUG")) {
    fprintf(stderr, "revisit in_view %d matches %zu inliers %zu %s move %.4f\n", in_view, matches,
            pose ? revisit.sights.size() : 0, pose ? "OK" : "-",
            pose ? (pose->translation - world_from_camera.translation).norm() : 0.0);
  }
  if (!pose) return std::nullopt;
  revisit.world_from_camera = *pose;
  return revisit;
}

std::optional<Rigid3> LandmarkMatcher::Verify(const Rigid3& start,
                                              std::vector<KnownSight>* sights) const {
  std::vector<DepthPoint> points;
  for (const KnownSight& sight : *sights) {
    DepthPoint point;
    point.reference = PointReference::At(start.translation, sight.point_in_world);
    point.inverse_depth = 1 / (sight.point_in_world - start.translation).norm();
    points.push_back(point);
  }
  std::optional<Rigid3> pose = start;
  std::vector<PointSight> views;
  for (const double factor : kSigmaFactors) {
    views.clear();
    for (size_t i = 0; i < points.size(); ++i) {
      views.push_back({&points[i], (*sights)[i].pixel, factor * (*sights)[i].sigma_px});
    }
    pose = Resect(options_.resection, camera_, views, *pose);
    if (!pose) return std::nullopt;
  }
  const CameraReference camera{*pose, &camera_};
  const CameraState state(camera);
  std::vector<KnownSight> inliers;
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (size_t i = 0; i < views.size(); ++i) {
    if (!(SightChi2(state, views[i]) < options_.resection.outlier_chi2)) continue;
    inliers.push_back((*sights)[i]);
    mean += views[i].pixel;
  }
  if (static_cast<int>(inliers.size()) < options_.resection.min_inliers) return std::nullopt;
  mean /= static_cast<double>(inliers.size());
  Eigen::Matrix2d spread = Eigen::Matrix2d::Zero();
  for (const KnownSight& sight : inliers) {
    spread += (sight.pixel - mean) * (sight.pixel - mean).transpose() /
              static_cast<double>(inliers.size());
  }
  const double least = Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(spread).eigenvalues()[0];
  if (!(std::sqrt(std::max(0.0, least)) > options_.min_spread_share * camera_.width_px())) {
    return std::nullopt;
  }
  *sights = std::move(inliers);
  return pose;
}

}  // namespace portolan
