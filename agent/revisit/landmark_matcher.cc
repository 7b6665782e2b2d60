#include "agent/revisit/landmark_matcher.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>

namespace portolan {
namespace {

// From coarse to fine: what is far off at first has little weight, but some.
constexpr std::array<double, 3> kSigmaFactors = {8, 3, 1};
// Descriptions nearer than this are of one point at several scales.
constexpr float kSamePointPx = 2;
constexpr int kNoDistanceBits = 257;

double LargestVariance(const Eigen::Matrix2d& covariance) {
  const double half = 0.5 * (covariance(0, 0) - covariance(1, 1));
  return 0.5 * covariance.trace() + std::hypot(half, covariance(0, 1));
}

int DistanceBits(const KnownLandmark& landmark, const Descriptor& descriptor) {
  int distance = kNoDistanceBits;
  for (const Descriptor& known : landmark.descriptors) {
    distance = std::min(distance, HammingDistance(known, descriptor));
  }
  return distance;
}

}  // namespace

// The features by cells of the search radius' size.
class LandmarkMatcher::FeatureGrid {
 public:
  FeatureGrid(std::span<const Feature> features, const CameraModel& camera, double cell_px)
      : features_(features),
        cell_px_(cell_px),
        columns_(static_cast<int>(camera.width_px() / cell_px) + 1),
        rows_(static_cast<int>(camera.height_px() / cell_px) + 1),
        cells_(static_cast<size_t>(columns_) * rows_) {
    for (size_t i = 0; i < features.size(); ++i) {
      const int column = std::clamp(CellOf(features[i].pixel.x()), 0, columns_ - 1);
      const int row = std::clamp(CellOf(features[i].pixel.y()), 0, rows_ - 1);
      Cell(column, row).push_back(static_cast<int>(i));
    }
  }

  // Calls function(index) for those within a cell's size of the pixel, which is in the image.
  template <typename Function>
  void ForEachNear(const Eigen::Vector2d& pixel, const Function& function) const {
    const int column = CellOf(pixel.x()), row = CellOf(pixel.y());
    for (int y = std::max(0, row - 1); y <= std::min(rows_ - 1, row + 1); ++y) {
      for (int x = std::max(0, column - 1); x <= std::min(columns_ - 1, column + 1); ++x) {
        for (const int i : cells_[static_cast<size_t>(y) * columns_ + x]) {
          const Eigen::Vector2d offset = features_[i].pixel.cast<double>() - pixel;
          if (offset.squaredNorm() <= cell_px_ * cell_px_) function(i);
        }
      }
    }
  }

 private:
  int CellOf(double coordinate) const {
    return static_cast<int>(std::floor(coordinate / cell_px_));
  }
  std::vector<int>& Cell(int column, int row) {
    return cells_[static_cast<size_t>(row) * columns_ + column];
  }

  const std::span<const Feature> features_;
  const double cell_px_;
  const int columns_;
  const int rows_;
  std::vector<std::vector<int>> cells_;
};

Status LandmarkMatcherOptions::Validate() const {
  PORTOLAN_RETURN_IF_ERROR(resection.Validate());
  if (newest_submaps_left_out < 1 || !(search_radius_share > 0 && search_radius_share < 1) ||
      max_distance_bits < 0 || min_margin_bits < 0 || !(max_distance_factor >= 1) ||
      !(max_view_angle_rad > 0) || !(sigma_px > 0) || !(max_landmark_sigma_px > 0) ||
      !(min_spread_share >= 0) || cells_across < 1) {
    return absl::InvalidArgumentError("revisit.matcher: a limit is out of range");
  }
  return absl::OkStatus();
}

std::vector<KnownSight> LandmarkMatcher::Match(const LandmarkMemory& memory, ComponentId component,
                                               uint32_t sequence_number,
                                               const Rigid3& world_from_camera,
                                               std::span<const Feature> features) const {
  const FeatureGrid grid(features, camera_, options_.search_radius_share * camera_.width_px());
  const Rigid3 camera_from_world = world_from_camera.Inverse();
  // By feature, so that each shows one landmark.
  std::map<int, std::pair<int, KnownSight>> best_of;
  for (const auto& [id, group] : memory.groups()) {
    if (group.component != component) continue;
    if (!id.offered && id.number + options_.newest_submaps_left_out > sequence_number) continue;
    for (uint32_t index = 0; index < group.landmarks.size(); ++index) {
      const KnownLandmark& landmark = group.landmarks[index];
      const auto view = Predict(landmark, world_from_camera, camera_from_world);
      if (!view) continue;
      const Nearest nearest = FindNearest(landmark, view->pixel, features, grid);
      if (nearest.feature < 0) continue;
      const KnownSight sight{{id, index, group.filling},
                             landmark.point_in_world,
                             features[nearest.feature].pixel.cast<double>(),
                             std::sqrt(options_.sigma_px * options_.sigma_px + view->variance_px2)};
      const auto [at, is_new] = best_of.try_emplace(nearest.feature, nearest.distance_bits, sight);
      if (!is_new && nearest.distance_bits < at->second.first) {
        at->second = {nearest.distance_bits, sight};
      }
    }
  }
  std::vector<KnownSight> sights;
  for (const auto& [feature, match] : best_of) sights.push_back(match.second);
  sights = Agreeing(world_from_camera, sights);
  if (sights.empty() || !IsSpread(sights)) return {};
  return BestOfCells(sights);
}

std::optional<LandmarkMatcher::InView> LandmarkMatcher::Predict(
    const KnownLandmark& landmark, const Rigid3& world_from_camera,
    const Rigid3& camera_from_world) const {
  const Eigen::Vector3d point = camera_from_world * landmark.point_in_world;
  if (!(point.z() > 0)) return std::nullopt;
  const Eigen::Vector3d then = landmark.point_in_world - landmark.seen_from_in_world;
  const Eigen::Vector3d now = landmark.point_in_world - world_from_camera.translation;
  const double then_norm = then.norm(), now_norm = now.norm();
  if (then_norm > options_.max_distance_factor * now_norm ||
      now_norm > options_.max_distance_factor * then_norm ||
      then.dot(now) < std::cos(options_.max_view_angle_rad) * then_norm * now_norm) {
    return std::nullopt;
  }
  Matrix23d d_pixel_d_point;
  const auto pixel = camera_.Project(point, &d_pixel_d_point);
  if (!pixel || !camera_.IsInImage(*pixel)) return std::nullopt;
  d_pixel_d_point *= camera_from_world.rotation.toRotationMatrix();
  const double variance =
      LargestVariance(d_pixel_d_point * landmark.covariance * d_pixel_d_point.transpose());
  if (!(variance < options_.max_landmark_sigma_px * options_.max_landmark_sigma_px)) {
    return std::nullopt;
  }
  return InView{*pixel, variance};
}

LandmarkMatcher::Nearest LandmarkMatcher::FindNearest(const KnownLandmark& landmark,
                                                      const Eigen::Vector2d& pixel,
                                                      std::span<const Feature> features,
                                                      const FeatureGrid& grid) const {
  Nearest best{-1, kNoDistanceBits};
  int second_bits = kNoDistanceBits;
  grid.ForEachNear(pixel, [&](int i) {
    const int distance = DistanceBits(landmark, features[i].descriptor);
    const bool is_other = best.feature < 0 ||
                          (features[i].pixel - features[best.feature].pixel).norm() > kSamePointPx;
    if (distance < best.distance_bits) {
      if (is_other) second_bits = best.distance_bits;
      best = {i, distance};
    } else if (is_other) {
      second_bits = std::min(second_bits, distance);
    }
  });
  if (best.distance_bits > options_.max_distance_bits ||
      second_bits < best.distance_bits + options_.min_margin_bits) {
    return {};
  }
  return best;
}

std::vector<KnownSight> LandmarkMatcher::Agreeing(const Rigid3& world_from_camera,
                                                  const std::vector<KnownSight>& sights) const {
  std::vector<DepthPoint> points(sights.size());
  for (size_t i = 0; i < sights.size(); ++i) {
    points[i].reference =
        PointReference::At(world_from_camera.translation, sights[i].point_in_world);
    points[i].inverse_depth = 1 / (sights[i].point_in_world - world_from_camera.translation).norm();
  }
  Rigid3 pose = world_from_camera;
  std::vector<PointSight> views;
  for (const double factor : kSigmaFactors) {
    views.clear();
    for (size_t i = 0; i < sights.size(); ++i) {
      views.push_back({&points[i], sights[i].pixel, factor * sights[i].sigma_px});
    }
    const auto found = Resect(options_.resection, camera_, views, pose);
    if (!found) return {};
    pose = *found;
  }
  const CameraReference camera{pose, &camera_};
  const CameraState state(camera);
  std::vector<KnownSight> agreeing;
  for (size_t i = 0; i < sights.size(); ++i) {
    if (SightChi2(state, views[i]) < options_.resection.outlier_chi2) agreeing.push_back(sights[i]);
  }
  return agreeing;
}

bool LandmarkMatcher::IsSpread(const std::vector<KnownSight>& sights) const {
  const double share = 1 / static_cast<double>(sights.size());
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (const KnownSight& sight : sights) mean += share * sight.pixel;
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();
  for (const KnownSight& sight : sights) {
    covariance += share * (sight.pixel - mean) * (sight.pixel - mean).transpose();
  }
  const double least = covariance.trace() - LargestVariance(covariance);
  const double wanted = options_.min_spread_share * camera_.width_px();
  return least >= wanted * wanted;
}

std::vector<KnownSight> LandmarkMatcher::BestOfCells(const std::vector<KnownSight>& sights) const {
  const double cell_px = static_cast<double>(camera_.width_px()) / options_.cells_across;
  std::map<std::pair<int, int>, const KnownSight*> best_of;
  for (const KnownSight& sight : sights) {
    const std::pair cell(static_cast<int>(sight.pixel.x() / cell_px),
                         static_cast<int>(sight.pixel.y() / cell_px));
    const auto [at, is_new] = best_of.try_emplace(cell, &sight);
    if (!is_new && sight.sigma_px < at->second->sigma_px) at->second = &sight;
  }
  std::vector<KnownSight> best;
  for (const auto& [cell, sight] : best_of) best.push_back(*sight);
  return best;
}

}  // namespace portolan
