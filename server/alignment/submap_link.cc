#include "server/alignment/submap_link.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "common/linear_algebra/dense.h"
#include "server/refinement/submap_refiner.h"

namespace portolan {
namespace {

struct LogScale {
  double mean = 0;
  double sigma = 1;
};

struct LogRatio {
  double value = 0;
  double variance = 1;
};

// Variance of log |p - origin|, the relative variance of the range.
double RangeVariance(const RefinedLandmark& landmark, const Eigen::Vector3d& origin) {
  const Eigen::Vector3d ray = landmark.point_in_submap - origin;
  return landmark.covariance.SquareOf(ray) / (ray.squaredNorm() * ray.squaredNorm());
}

std::vector<LogRatio> SharedRatios(const RefinedSubmap& predecessor,
                                   const RefinedSubmap& successor) {
  std::vector<LogRatio> ratios;
  const Eigen::Vector3d origin = predecessor.submap_from_camera.back().translation;
  for (const RefinedLandmark& after : successor.landmarks) {
    const RefinedLandmark* before = FindLandmark(predecessor, after.track);
    if (before == nullptr) continue;
    LogRatio ratio;
    ratio.value =
        std::log((before->point_in_submap - origin).norm() / after.point_in_submap.norm());
    ratio.variance = RangeVariance(*before, origin) + RangeVariance(after, Eigen::Vector3d::Zero());
    if (std::isfinite(ratio.value) && ratio.variance < 1) ratios.push_back(ratio);
  }
  return ratios;
}

// Weighted mean with Cauchy weights, started at the weighted median, together with the filter's
// own belief in scale 1.
LogScale RobustLogScale(const SubmapLinkOptions& options, std::vector<LogRatio> ratios) {
  const double prior = 1.0 / (options.carried_log_scale_sigma * options.carried_log_scale_sigma);
  if (ratios.empty()) return {0, options.carried_log_scale_sigma};
  std::sort(ratios.begin(), ratios.end(),
            [](const LogRatio& a, const LogRatio& b) { return a.value < b.value; });
  double half = 0;
  for (const LogRatio& ratio : ratios) half += 0.5 / ratio.variance;
  LogScale scale;
  for (const LogRatio& ratio : ratios) {
    scale.mean = ratio.value;
    half -= 1.0 / ratio.variance;
    if (half <= 0) break;
  }
  double information = 0;
  for (int i = 0; i < 10; ++i) {
    double sum = 0;
    information = ratios.size() < 3 ? prior : 0;
    for (const LogRatio& ratio : ratios) {
      const double error = ratio.value - scale.mean;
      const double weight = 1.0 / (ratio.variance + 0.25 * error * error);
      information += weight;
      sum += weight * ratio.value;
    }
    scale.mean = sum / information;
  }
  scale.sigma = std::max(1.0 / std::sqrt(information), options.min_log_scale_sigma);
  return scale;
}

double MedianLandmarkDepth(const RefinedSubmap& submap) {
  std::vector<double> depths;
  for (const RefinedLandmark& landmark : submap.landmarks) {
    depths.push_back(landmark.point_in_submap.norm());
  }
  if (depths.empty()) return 1.0;
  std::nth_element(depths.begin(), depths.begin() + depths.size() / 2, depths.end());
  return depths[depths.size() / 2];
}

}  // namespace

Status SubmapLinkOptions::Validate() const {
  if (!(carried_log_scale_sigma > 0) || !(min_log_scale_sigma > 0) ||
      !(min_rotation_sigma_rad > 0) || !(min_translation_sigma_of_depth > 0)) {
    return absl::InvalidArgumentError("link: every sigma must be positive");
  }
  return absl::OkStatus();
}

SubmapRelation LinkToPredecessor(const SubmapLinkOptions& options, const RefinedSubmap& predecessor,
                                 const RefinedSubmap& successor) {
  const LogScale scale = RobustLogScale(options, SharedRatios(predecessor, successor));
  SubmapRelation link;
  link.a = predecessor.id;
  link.b = successor.id;
  link.a_from_b =
      Similarity3::FromRigid(predecessor.submap_from_camera.back(), std::exp(scale.mean));
  Matrix7d covariance = Matrix7d::Zero();
  covariance.topLeftCorner<6, 6>() = predecessor.last_keyframe_covariance;
  const double translation =
      options.min_translation_sigma_of_depth * MedianLandmarkDepth(predecessor);
  const double rotation = options.min_rotation_sigma_rad;
  covariance.diagonal().head<3>().array() += translation * translation;
  covariance.diagonal().segment<3>(3).array() += rotation * rotation;
  // The perturbation's translation is in the successor's units.
  covariance.topRows<3>() /= link.a_from_b.scale;
  covariance.leftCols<3>() /= link.a_from_b.scale;
  covariance(6, 6) = scale.sigma * scale.sigma;
  link.information = InverseOfPositiveDefinite(covariance);
  return link;
}

}  // namespace portolan
