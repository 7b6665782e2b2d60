#include "agent/stereo/stereo_matcher.h"

#include <algorithm>
#include <cmath>

#include "agent/tracker/patch_flow.h"
#include "agent/tracker/reference_patch.h"

namespace portolan {
namespace {

// Distance of the starts along the epipolar curve: within the reach of the flow at its coarse
// level.
constexpr double kStepPx = 6.0;
constexpr int kMaxSteps = 96;
constexpr int kIterations = 6;
// As far as a rig of any size can tell from infinity.
constexpr double kLeastInverseDepth = 1e-3;
// A match may lie this much beyond infinity, or nearer than the nearest distance, in sigmas.
constexpr double kMaxSigmas = 3.0;

}  // namespace

Status StereoOptions::Validate() const {
  if (!(nearest_m > 0)) return absl::InvalidArgumentError("stereo.nearest_m must be positive");
  if (!(min_correlation > 0 && min_correlation < 1)) {
    return absl::InvalidArgumentError("stereo.min_correlation must be within 0 and 1");
  }
  if (!(max_epipolar_px > 0)) {
    return absl::InvalidArgumentError("stereo.max_epipolar_px must be positive");
  }
  if (!(calibration_sigma_px >= 0)) {
    return absl::InvalidArgumentError("stereo.calibration_sigma_px must not be negative");
  }
  if (pyramid_levels < 0 || pyramid_levels > 8) {
    return absl::InvalidArgumentError("stereo.pyramid_levels must be within 0 and 8");
  }
  return absl::OkStatus();
}

StereoMatcher::StereoMatcher(const StereoOptions& options, const CameraModel& first,
                             const StereoMount& mount)
    : options_(options), first_(first), mount_(mount) {}

void StereoMatcher::SetImages(const cv::Mat& first, const cv::Mat& second) {
  first_image_ = first;
  second_image_ = second;
  has_pyramids_ = false;
}

std::optional<Eigen::Vector2d> StereoMatcher::Predict(
    const Eigen::Vector3d& ray, double inverse_depth,
    Eigen::Vector2d* d_pixel_d_inverse_depth) const {
  // The point in the second camera times its inverse depth, finite at infinity.
  const Eigen::Vector3d direction = mount_.camera_from_first.rotation * ray +
                                    inverse_depth * mount_.camera_from_first.translation;
  Matrix23d d_pixel_d_direction;
  const auto pixel = mount_.camera.Project(direction, &d_pixel_d_direction);
  if (pixel) *d_pixel_d_inverse_depth = d_pixel_d_direction * mount_.camera_from_first.translation;
  return pixel;
}

std::optional<StereoMatcher::Depth> StereoMatcher::FitDepth(const Eigen::Vector3d& ray,
                                                            double start,
                                                            const Eigen::Vector2d& match,
                                                            double sigma_px) const {
  double inverse_depth = start;
  Eigen::Vector2d slope;
  for (int i = 0; i < kIterations; ++i) {
    const auto pixel = Predict(ray, inverse_depth, &slope);
    if (!pixel || !(slope.squaredNorm() > 0)) return std::nullopt;
    inverse_depth += slope.dot(match - *pixel) / slope.squaredNorm();
  }
  const auto pixel = Predict(ray, inverse_depth, &slope);
  if (!pixel || !((match - *pixel).norm() < options_.max_epipolar_px)) return std::nullopt;
  const double sigma = std::hypot(sigma_px, options_.calibration_sigma_px) / slope.norm();
  const double slack = kMaxSigmas * sigma;
  if (!(inverse_depth > -slack && inverse_depth < 1.0 / options_.nearest_m + slack)) {
    return std::nullopt;
  }
  return Depth{std::max(inverse_depth, kLeastInverseDepth), sigma};
}

std::optional<StereoMatcher::Depth> StereoMatcher::Measure(const Eigen::Vector2d& pixel) {
  if (!has_pyramids_) {
    first_pyramid_.Build(first_image_, options_.pyramid_levels);
    second_pyramid_.Build(second_image_, options_.pyramid_levels);
    has_pyramids_ = true;
  }
  const auto ray = first_.Unproject(pixel);
  if (!ray) return std::nullopt;
  Eigen::Vector2d slope;
  const auto farthest = Predict(*ray, 0.0, &slope);
  const double reach_px =
      farthest ? slope.norm() / options_.nearest_m : kStepPx * static_cast<double>(kMaxSteps);
  const int steps = std::clamp(static_cast<int>(std::ceil(reach_px / kStepPx)), 1, kMaxSteps);
  std::vector<Eigen::Vector2d> starts;
  std::vector<double> inverse_depths;
  for (int i = 0; i <= steps; ++i) {
    const double inverse_depth = static_cast<double>(i) / steps / options_.nearest_m;
    const auto start = Predict(*ray, inverse_depth, &slope);
    if (!start || !mount_.camera.IsInImage(*start)) continue;
    starts.push_back(*start);
    inverse_depths.push_back(inverse_depth);
  }
  const auto moved = TrackTranslation(first_pyramid_, second_pyramid_, pixel, starts, 0);
  if (!moved) return std::nullopt;
  const auto patch = ReferencePatch::Create(first_pyramid_, pixel);
  if (!patch) return std::nullopt;
  const auto aligned = patch->Align(second_pyramid_, {*moved, Eigen::Matrix2d::Identity()});
  if (!aligned || aligned->correlation < options_.min_correlation) return std::nullopt;
  const Eigen::Vector2d& match = aligned->pose.pixel;
  const auto nearest = std::min_element(
      starts.begin(), starts.end(), [&match](const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
        return (a - match).squaredNorm() < (b - match).squaredNorm();
      });
  return FitDepth(*ray, inverse_depths[nearest - starts.begin()], match, aligned->sigma_px);
}

std::vector<MeasuredDepth> StereoMatcher::Measure(std::span<const Measurement> points) {
  std::vector<MeasuredDepth> depths;
  for (const Measurement& point : points) {
    const auto depth = Measure(point.pixel);
    if (depth) depths.push_back({point.track, depth->inverse_depth, depth->sigma, true});
  }
  return depths;
}

}  // namespace portolan
