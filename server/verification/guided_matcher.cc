#include "server/verification/guided_matcher.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace portolan {
namespace {

constexpr int kCellPx = 32;

// Features of a keyframe by image cell.
class FeatureGrid {
 public:
  FeatureGrid(const DescribedKeyframe& keyframe, const CameraModel& camera)
      : columns_(camera.width_px() / kCellPx + 1), rows_(camera.height_px() / kCellPx + 1) {
    cells_.resize(static_cast<size_t>(columns_) * rows_);
    for (size_t i = 0; i < keyframe.pixels.size(); ++i) {
      const Eigen::Vector2d pixel = keyframe.pixels[i].cast<double>();
      cells_[Index(Column(pixel.x()), Row(pixel.y()))].push_back(i);
    }
  }

  template <typename Visitor>
  void VisitNear(const Eigen::Vector2d& pixel, double radius, const Visitor& visit) const {
    for (int row = Row(pixel.y() - radius); row <= Row(pixel.y() + radius); ++row) {
      for (int c = Column(pixel.x() - radius); c <= Column(pixel.x() + radius); ++c) {
        for (const size_t feature : cells_[Index(c, row)]) visit(feature);
      }
    }
  }

 private:
  int Column(double x) const {
    return static_cast<int>(std::clamp(x / kCellPx, 0.0, columns_ - 1.0));
  }
  int Row(double y) const { return static_cast<int>(std::clamp(y / kCellPx, 0.0, rows_ - 1.0)); }
  size_t Index(int column, int row) const { return static_cast<size_t>(row) * columns_ + column; }

  const int columns_, rows_;
  std::vector<std::vector<size_t>> cells_;
};

// Where a feature was described, a point each.
struct FeatureRef {
  const DescribedKeyframe* keyframe;
  size_t index;
};

std::vector<std::vector<FeatureRef>> FeaturesOfPoints(const SubmapPoints& submap) {
  std::vector<std::vector<FeatureRef>> features(submap.points.size());
  for (const DescribedKeyframe& keyframe : submap.keyframes) {
    for (size_t i = 0; i < keyframe.points.size(); ++i) {
      features[keyframe.points[i]].push_back({&keyframe, i});
    }
  }
  return features;
}

// The predicted sight of a landmark.
struct Prediction {
  Eigen::Vector2d pixel;
  Eigen::Matrix2d information;
  double radius_px;
};

// Searches the keyframes of `other` for the landmarks of `own`. Matches are (own, other).
class Search {
 public:
  Search(const SubmapPoints& own, const SubmapPoints& other, const Similarity3& other_from_own,
         const GuidedMatcherOptions& options)
      : own_(own),
        other_(other),
        other_from_own_(other_from_own),
        options_(options),
        features_(FeaturesOfPoints(own)) {}

  std::vector<PointMatch> Run(bool of_a, GuidedMatches* guided) {
    std::vector<PointMatch> matches;
    std::vector<bool> visible(own_.points.size());
    for (const DescribedKeyframe& keyframe : other_.keyframes) {
      const FeatureGrid grid(keyframe, *other_.submap->camera);
      for (size_t p = 0; p < own_.points.size(); ++p) {
        if (own_.points[p].landmark == nullptr) continue;
        const auto prediction = Predict(*own_.points[p].landmark, keyframe.keyframe);
        if (!prediction) continue;
        visible[p] = true;
        guided->sights.push_back({of_a, static_cast<int>(p), keyframe.keyframe, prediction->pixel});
        const auto match = Find(static_cast<int>(p), *prediction, keyframe, grid);
        if (match) matches.push_back(*match);
      }
    }
    guided->predicted += static_cast<int>(std::count(visible.begin(), visible.end(), true));
    return matches;
  }

 private:
  std::optional<Prediction> Predict(const RefinedLandmark& landmark, int keyframe) const {
    const Rigid3& camera_from_other = other_.camera_from_submap[keyframe];
    Matrix23d d_pixel_d_point;
    const CameraModel& camera = *other_.submap->camera;
    const auto pixel = camera.Project(
        camera_from_other * (other_from_own_ * landmark.point_in_submap), &d_pixel_d_point);
    if (!pixel || !camera.IsInImage(*pixel)) return std::nullopt;
    const Matrix23d jacobian =
        other_from_own_.scale * d_pixel_d_point *
        (camera_from_other.rotation * other_from_own_.rotation).toRotationMatrix();
    Eigen::Matrix2d covariance = jacobian * landmark.covariance.Matrix() * jacobian.transpose();
    covariance.diagonal().array() += options_.relation_sigma_px * options_.relation_sigma_px;
    const double radius =
        std::min(options_.max_radius_px,
                 options_.sigmas * std::sqrt(std::max(covariance(0, 0), covariance(1, 1))));
    const Eigen::Matrix2d information = covariance.inverse();
    if (!information.allFinite() || !std::isfinite(radius)) return std::nullopt;
    return Prediction{*pixel, information, radius};
  }

  // Distance of the nearest description of the point.
  std::pair<int, int> DistanceTo(int point, const Descriptor& descriptor) const {
    std::pair<int, int> nearest(257, 0);  // bits, keyframe
    for (const FeatureRef& ref : features_[point]) {
      const int distance = HammingDistance(ref.keyframe->descriptors[ref.index], descriptor);
      nearest = std::min(nearest, {distance, ref.keyframe->keyframe});
    }
    return nearest;
  }

  std::optional<PointMatch> Find(int point, const Prediction& prediction,
                                 const DescribedKeyframe& keyframe, const FeatureGrid& grid) const {
    PointMatch best;
    best.distance_bits = 257;
    int second = 257;
    const double gate = options_.sigmas * options_.sigmas;
    grid.VisitNear(prediction.pixel, prediction.radius_px, [&](size_t f) {
      const Eigen::Vector2d error = keyframe.pixels[f].cast<double>() - prediction.pixel;
      if (error.norm() > prediction.radius_px || error.dot(prediction.information * error) > gate) {
        return;
      }
      const auto [distance, own_keyframe] = DistanceTo(point, keyframe.descriptors[f]);
      const int candidate = keyframe.points[f];
      if (distance < best.distance_bits) {
        if (candidate != best.b) second = best.distance_bits;
        best = {point, candidate, distance, own_keyframe, keyframe.keyframe};
      } else if (candidate != best.b) {
        second = std::min(second, distance);
      }
    });
    const bool distinct = best.distance_bits < options_.max_ratio * second;
    if (best.distance_bits > options_.max_distance_bits || !distinct) return std::nullopt;
    return best;
  }

  const SubmapPoints& own_;
  const SubmapPoints& other_;
  const Similarity3 other_from_own_;
  const GuidedMatcherOptions& options_;
  const std::vector<std::vector<FeatureRef>> features_;
};

}  // namespace

GuidedMatches MatchGuided(const SubmapPoints& a, const SubmapPoints& b, const Similarity3& a_from_b,
                          const GuidedMatcherOptions& options) {
  GuidedMatches guided;
  std::vector<PointMatch> found = Search(a, b, a_from_b.Inverse(), options).Run(true, &guided);
  for (PointMatch match : Search(b, a, a_from_b, options).Run(false, &guided)) {
    std::swap(match.a, match.b);
    std::swap(match.keyframe_a, match.keyframe_b);
    found.push_back(match);
  }
  guided.matches = KeepOneToOne(std::move(found), a.points.size(), b.points.size());
  return guided;
}

}  // namespace portolan
