#include "agent/range/range_scale.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace portolan {
namespace {

// Ranges at which the ray is looked for in the image.
constexpr int kProbes = 40;

bool IsRayInImage(const RangeFinder& finder, const CameraModel& camera) {
  for (int i = 0; i <= kProbes; ++i) {
    const double share = static_cast<double>(i) / kProbes;
    const double range =
        finder.min_range_m * std::pow(finder.max_range_m / finder.min_range_m, share);
    const auto pixel =
        camera.Project(finder.position_in_camera_m + range * finder.direction_in_camera);
    if (pixel && camera.IsInImage(*pixel)) return true;
  }
  return false;
}

}  // namespace

Status RangeOptions::Validate() const {
  PORTOLAN_RETURN_IF_ERROR(scale.Validate());
  for (const double value :
       {max_age_s, spot_interval_s, min_parallax_rad, max_depth_sigma_ratio, good_depth_sigma_ratio,
        spot_sigma, map_sigma, scale_drift, gate_chi2, trusted_gap_s}) {
    if (!(value > 0 && std::isfinite(value))) {
      return absl::InvalidArgumentError("range: every number must be > 0");
    }
  }
  if (max_spots < 1 || max_spots > 1000) {
    return absl::InvalidArgumentError("range.max_spots must be within 1 and 1000");
  }
  if (max_rejected_in_row < 1) {
    return absl::InvalidArgumentError("range.max_rejected_in_row must be >= 1");
  }
  return absl::OkStatus();
}

StatusOr<RangeScale> RangeScale::Create(const RangeOptions& options, const RangeFinder& finder,
                                        const CameraModel& camera) {
  PORTOLAN_RETURN_IF_ERROR(options.Validate());
  if (!(finder.position_in_camera_m.allFinite() &&
        std::abs(finder.direction_in_camera.norm() - 1) < 1e-6 && finder.sigma_m > 0 &&
        finder.min_range_m > 0 && finder.max_range_m > finder.min_range_m)) {
    return absl::InvalidArgumentError("range finder: its calibration is out of range");
  }
  if (!IsRayInImage(finder, camera)) {
    return absl::InvalidArgumentError(
        "range finder: by its calibration the camera never sees where it points");
  }
  return RangeScale(options, finder, camera);
}

RangeScale::RangeScale(const RangeOptions& options, const RangeFinder& finder,
                       const CameraModel& camera)
    : options_(options),
      finder_(finder),
      camera_(camera),
      samples_(finder),
      depths_({.method = InitializationMethod::kMultiView,
               .min_parallax_rad = options.min_parallax_rad,
               .max_sigma_ratio = options.max_depth_sigma_ratio,
               .view_interval_frames = 2},
              camera),
      scale_(options.scale) {}

void RangeScale::Reset() {
  depths_.Reset();
  spots_.clear();
  new_spot_.reset();
  scale_.Reset();
  last_inside_.reset();
  last_frame_.reset();
  rejected_in_row_ = 0;
  log_scale_ = log_scale_variance_ = 0;
}

void RangeScale::Rebase(const Rigid3& old_from_new) {
  depths_.Rebase(old_from_new);
  const Rigid3 new_from_old = old_from_new.Inverse();
  for (Spot& spot : spots_) spot.camera_in_submap = new_from_old * spot.camera_in_submap;
}

void RangeScale::ScaleLengths(double scale) {
  depths_.Rescale(scale);
  for (Spot& spot : spots_) {
    spot.camera_in_submap *= scale;
    if (spot.ratio) spot.ratio->log_scale -= std::log(scale);
  }
}

void RangeScale::Rescale(double scale) {
  ScaleLengths(scale);
  scale_.Reset();
}

void RangeScale::FindSpot(const LocalFilter& filter) {
  const auto sample = samples_.Take(filter.time(), FromSeconds(options_.max_age_s));
  if (!sample) return;
  const Eigen::Vector3d point =
      finder_.position_in_camera_m + sample->range_m * finder_.direction_in_camera;
  Spot spot;
  spot.time = sample->time;
  spot.distance_m = point.norm();
  spot.sigma_m = sample->sigma_m;
  // The camera has moved on since. Without a scale the spot is taken to be where the scene is.
  const double age_s = ToSeconds(filter.time() - sample->time);
  const Rigid3 camera = filter.submap_from_camera();
  const double distance = filter.has_scale() || filter.metric()
                              ? spot.distance_m * std::exp(-log_scale_)
                              : 1 / filter.median_inverse_depth();
  const Eigen::Vector3d then =
      RotationExp(-age_s * filter.angular_velocity_rad_s()) * (distance / spot.distance_m * point);
  const Eigen::Vector3d way = age_s * filter.linear_velocity();
  spot.camera_in_submap = camera.translation - way;
  const auto pixel = camera_.Project(then - camera.rotation.conjugate() * way);
  if (!pixel || !camera_.IsInImage(*pixel)) {
    ++counts_.off_image;
    return;
  }
  spot.pixel = *pixel;
  new_spot_ = spot;
}

std::optional<Eigen::Vector2d> RangeScale::SpotToFollow() const {
  if (!new_spot_ || static_cast<int>(spots_.size()) >= options_.max_spots) return std::nullopt;
  if (last_followed_ &&
      ToSeconds(new_spot_->time - *last_followed_) < 0.99 * options_.spot_interval_s) {
    return std::nullopt;
  }
  return new_spot_->pixel;
}

void RangeScale::Follow(TrackId track) {
  new_spot_->track = track;
  last_followed_ = new_spot_->time;
  spots_.push_back(*new_spot_);
  new_spot_.reset();
  ++counts_.followed;
}

void RangeScale::Measure(const LocalFilter& filter, Spot* spot) const {
  std::vector<TrackId> one = {spot->track};
  const std::vector<MeasuredDepth> depth = depths_.Measure(&one);
  if (depth.empty()) return;
  const double relative_depth = depth[0].sigma / depth[0].inverse_depth;
  if (spot->ratio && relative_depth > spot->depth_sigma_ratio) return;
  const Eigen::Vector3d point =
      filter.submap_from_camera() *
      Eigen::Vector3d(depths_.PresentBearing(spot->track) / depth[0].inverse_depth);
  const double distance = (point - spot->camera_in_submap).norm();
  const double relative_range = spot->sigma_m / spot->distance_m;
  spot->depth_sigma_ratio = relative_depth;
  spot->ratio = {filter.time(), std::log(spot->distance_m / distance),
                 relative_depth * relative_depth + relative_range * relative_range +
                     options_.spot_sigma * options_.spot_sigma,
                 options_.map_sigma * options_.map_sigma};
}

bool RangeScale::UpdateScale(const ScaleFinder::Ratio& ratio) {
  const double innovation = ratio.log_scale - log_scale_;
  const double variance = log_scale_variance_ + ratio.own_variance + ratio.shared_variance;
  if (innovation * innovation > options_.gate_chi2 * variance) return false;
  const double gain = log_scale_variance_ / variance;
  log_scale_ += gain * innovation;
  log_scale_variance_ *= 1 - gain;
  return true;
}

bool RangeScale::UpdateFilter(const ScaleFinder::Ratio& ratio, LocalFilter* filter) const {
  const auto d_scale = filter->DScaleDState();
  if (!d_scale) return false;
  // The spot is as far as the map as a whole says, in logarithms of inverse lengths.
  const LocalFilter::LengthMeasurement measurement = {*d_scale, -ratio.log_scale,
                                                      ratio.own_variance + ratio.shared_variance};
  return filter->UpdateWithLength(measurement, options_.gate_chi2);
}

std::optional<double> RangeScale::TakeScale(LocalFilter* filter) {
  const auto found = scale_.Find();
  if (!found) return std::nullopt;
  const double scale = std::exp(found->log_scale);
  if (!filter->TakeScale(scale)) return std::nullopt;
  Rescale(scale);
  rejected_in_row_ = 0;
  log_scale_ = 0;
  log_scale_variance_ = found->sigma * found->sigma;
  last_inside_ = filter->time();
  return scale;
}

double RangeScale::CorrectScale(LocalFilter* filter) {
  const double scale = std::exp(log_scale_);
  const bool trusted = filter->metric();
  if (log_scale_ == 0 || !filter->has_scale() || !filter->TakeScale(scale)) return 1;
  filter->TrustScale(trusted);
  ScaleLengths(scale);
  log_scale_ = 0;
  return scale;
}

// What a frame does to the scale whether there is a range or not.
void RangeScale::Drift(LocalFilter* filter) {
  if (last_frame_ && filter->time() > *last_frame_) {
    const double way_depths = ToSeconds(filter->time() - *last_frame_) *
                              filter->linear_velocity().norm() * filter->median_inverse_depth();
    log_scale_variance_ += options_.scale_drift * options_.scale_drift * way_depths;
  }
  last_frame_ = filter->time();
  if (!filter->has_scale()) return;
  filter->TrustScale(last_inside_ &&
                     ToSeconds(filter->time() - *last_inside_) <= options_.trusted_gap_s);
}

std::optional<double> RangeScale::TakeRatio(const ScaleFinder::Ratio& ratio, LocalFilter* filter) {
  const bool seeks = !filter->metric() && !filter->has_scale();
  if (!seeks && (filter->has_scale() ? UpdateScale(ratio) : UpdateFilter(ratio, filter))) {
    ++counts_.used;
    scale_.Reset();
    rejected_in_row_ = 0;
    last_inside_ = filter->time();
    return std::nullopt;
  }
  // Those that do not fit in a row may agree on another scale.
  scale_.Add(ratio);
  ++(seeks ? counts_.used : counts_.rejected);
  if (!seeks && ++rejected_in_row_ < options_.max_rejected_in_row) return std::nullopt;
  return TakeScale(filter);
}

std::optional<double> RangeScale::Use(const std::vector<TrackedPoint>& points,
                                      LocalFilter* filter) {
  Drift(filter);
  new_spot_.reset();
  if (filter->starting()) {
    // What is triangulated with poses that will be taken back is of no use.
    spots_.clear();
    depths_.Reset();
    return std::nullopt;
  }
  std::vector<TrackedPoint> seen;
  std::vector<Spot> live, ended;
  for (Spot& spot : spots_) {
    const TrackedPoint* point = FindPoint(points, spot.track);
    const bool is_live = point != nullptr;
    if (is_live) seen.push_back(*point);
    (is_live ? live : ended).push_back(std::move(spot));
  }
  depths_.AddFrame(filter->submap_from_camera(), seen);
  spots_.clear();
  for (Spot& spot : live) {
    Measure(*filter, &spot);
    const bool good = spot.ratio && spot.depth_sigma_ratio <= options_.good_depth_sigma_ratio;
    (good ? ended : spots_).push_back(std::move(spot));
  }
  std::optional<double> scale;
  for (const Spot& spot : ended) {
    if (!spot.ratio) {
      ++counts_.lost;
    } else if (!scale) {  // the others are in the old unit
      scale = TakeRatio(*spot.ratio, filter);
    }
  }
  FindSpot(*filter);
  return scale;
}

}  // namespace portolan
