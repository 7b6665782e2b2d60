#include "agent/landmarks/landmark_initializer.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "agent/landmarks/two_view_geometry.h"
#include "common/base/check.h"

namespace portolan {
namespace {

// Two depths of one landmark that differ by more are of different points.
constexpr double kMaxDepthSigmas = 3.0;

double AngleBetween(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

}  // namespace

Status LandmarkInitializerOptions::Validate() const {
  if (!(min_parallax_rad > 0 && min_parallax_rad < 1)) {
    return absl::InvalidArgumentError("initialization.min_parallax_rad must be within 0 and 1");
  }
  if (!(max_sigma_ratio > 0 && max_sigma_ratio <= 1)) {
    return absl::InvalidArgumentError("initialization.max_sigma_ratio must be within 0 and 1");
  }
  if (view_interval_frames < 1 || max_views < 1 || max_views > 1000) {
    return absl::InvalidArgumentError(
        "initialization.view_interval_frames must be positive and max_views within 1 and 1000");
  }
  if (!(pixel_sigma_px > 0 && std::isfinite(pixel_sigma_px))) {
    return absl::InvalidArgumentError("initialization.pixel_sigma_px must be positive");
  }
  if (min_landmarks < 0) {
    return absl::InvalidArgumentError("initialization.min_landmarks must not be negative");
  }
  return absl::OkStatus();
}

DepthEstimate FuseDepths(const DepthEstimate& a, const DepthEstimate& b) {
  const double variance = a.sigma * a.sigma;
  const double gain = variance / (variance + b.sigma * b.sigma);
  return {a.inverse_depth + gain * (b.inverse_depth - a.inverse_depth),
          std::sqrt((1 - gain) * variance)};
}

LandmarkInitializer::LandmarkInitializer(const LandmarkInitializerOptions& options,
                                         const CameraModel& camera)
    : options_(options), camera_(camera) {}

void LandmarkInitializer::Reset() {
  frame_count_ = 0;
  frames_.clear();
  candidates_.clear();
}

void LandmarkInitializer::Rebase(const Rigid3& old_from_new) {
  const Rigid3 new_from_old = old_from_new.Inverse();
  submap_from_camera_ = new_from_old * submap_from_camera_;
  for (Frame& frame : frames_) frame.submap_from_camera = new_from_old * frame.submap_from_camera;
}

void LandmarkInitializer::Rescale(double scale) {
  submap_from_camera_.translation *= scale;
  for (Frame& frame : frames_) frame.submap_from_camera.translation *= scale;
}

void LandmarkInitializer::AddFrame(const Rigid3& submap_from_camera,
                                   const std::vector<TrackedPoint>& points) {
  if (options_.method == InitializationMethod::kInverseDepth) return;
  // The frame before this one becomes a view of its tracks if it is an n-th one.
  const bool keep = frame_count_ > 0 && frame_count_ % options_.view_interval_frames == 0;
  if (keep) frames_.push_back({frame_count_, submap_from_camera_});
  if (static_cast<int>(frames_.size()) > options_.max_views) frames_.pop_front();
  for (auto& [track, candidate] : candidates_) {
    if (keep && candidate.live) candidate.views.push_back({frame_count_, candidate.bearing});
    while (!candidate.views.empty() && candidate.views.front().frame < frames_.front().number) {
      candidate.views.pop_front();
    }
    candidate.live = false;
  }
  ++frame_count_;
  submap_from_camera_ = submap_from_camera;
  for (const TrackedPoint& point : points) {
    const auto bearing = camera_.Unproject(point.pixel);
    const auto beside = camera_.Unproject(point.pixel + Eigen::Vector2d(1, 0));
    if (!bearing || !beside) continue;
    Candidate& candidate = candidates_[point.track];
    candidate.bearing = *bearing;
    candidate.sigma_rad =
        std::hypot(point.sigma_px, options_.pixel_sigma_px) * AngleBetween(*bearing, *beside);
    candidate.live = true;
  }
  std::erase_if(candidates_, [](const auto& entry) { return !entry.second.live; });
}

const LandmarkInitializer::Frame& LandmarkInitializer::FrameOf(int number) const {
  const auto it = std::lower_bound(frames_.begin(), frames_.end(), number,
                                   [](const Frame& f, int wanted) { return f.number < wanted; });
  PORTOLAN_CHECK(it != frames_.end() && it->number == number);
  return *it;
}

BearingView LandmarkInitializer::ViewFromPresent(const View& view) const {
  return {FrameOf(view.frame).submap_from_camera.Inverse() * submap_from_camera_, view.bearing};
}

bool LandmarkInitializer::IsReady(TrackId track) const {
  const auto it = candidates_.find(track);
  if (it == candidates_.end() || it->second.views.empty()) return false;
  const View& first = it->second.views.front();
  const Eigen::Vector3d then = FrameOf(first.frame).submap_from_camera.rotation * first.bearing;
  return AngleBetween(then, submap_from_camera_.rotation * it->second.bearing) >=
         options_.min_parallax_rad;
}

std::vector<BearingView> LandmarkInitializer::ViewsFromPresent(const Candidate& candidate) const {
  std::vector<BearingView> views;
  views.reserve(candidate.views.size());
  for (const View& view : candidate.views) views.push_back(ViewFromPresent(view));
  return views;
}

std::optional<DepthEstimate> LandmarkInitializer::Triangulate(const Candidate& candidate,
                                                              const BearingView& view) const {
  const auto inverse_depth = InverseDepthByDlt(candidate.bearing, view);
  if (!inverse_depth) return std::nullopt;
  const InverseDepthPoint point = MakeInverseDepthPoint(candidate.bearing, *inverse_depth);
  // Rays that miss each other are no match.
  const auto residual = ResidualOf(view, point);
  if (!residual || residual->value.norm() > kMaxDepthSigmas * candidate.sigma_rad) {
    return std::nullopt;
  }
  const auto sigma = InverseDepthSigma(point, {&view, 1}, candidate.sigma_rad);
  if (!sigma) return std::nullopt;
  return DepthEstimate{*inverse_depth, *sigma};
}

std::optional<DepthEstimate> LandmarkInitializer::MultiView(const Candidate& candidate) const {
  const std::vector<BearingView> views = ViewsFromPresent(candidate);
  const auto start = InverseDepthByDlt(candidate.bearing, views.front());
  if (!start) return std::nullopt;
  return InverseDepthByLevenbergMarquardt(candidate.bearing, *start, views, candidate.sigma_rad);
}

int LandmarkInitializer::SharedFrame(const std::vector<TrackId>& tracks) const {
  std::map<int, int> count;
  for (TrackId track : tracks) {
    for (const View& view : candidates_.at(track).views) ++count[view.frame];
  }
  // The oldest of those that most tracks share.
  const auto most = std::max_element(
      count.begin(), count.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
  return most == count.end() ? -1 : most->first;
}

std::optional<LandmarkInitializer::Geometry> LandmarkInitializer::FindGeometry(
    const std::vector<TrackId>& tracks) const {
  const int frame = SharedFrame(tracks);
  if (frame < 0) return std::nullopt;
  // In order of the tracks, so that equal runs draw equal samples.
  std::map<TrackId, BearingPair> pairs;
  double sigma_rad = 0;
  for (const auto& [track, candidate] : candidates_) {
    for (const View& view : candidate.views) {
      if (view.frame != frame) continue;
      pairs[track] = {candidate.bearing, view.bearing};
      sigma_rad = std::max(sigma_rad, candidate.sigma_rad);
    }
  }
  std::vector<BearingPair> ordered;
  for (const auto& [track, pair] : pairs) ordered.push_back(pair);
  auto pose = PoseOfTwoViews(ordered, sigma_rad);
  if (!pose) return std::nullopt;
  const Rigid3 by_filter = FrameOf(frame).submap_from_camera.Inverse() * submap_from_camera_;
  pose->translation *= by_filter.translation.norm();
  return Geometry{frame, *pose};
}

std::optional<DepthEstimate> LandmarkInitializer::Corrected(const Candidate& candidate,
                                                            const DepthEstimate& depth,
                                                            const Geometry& geometry) const {
  for (const View& view : candidate.views) {
    if (view.frame != geometry.frame) continue;
    const auto other = Triangulate(candidate, {geometry.then_from_now, view.bearing});
    if (!other) return depth;
    const double innovation = std::abs(other->inverse_depth - depth.inverse_depth);
    if (innovation > kMaxDepthSigmas * std::hypot(depth.sigma, other->sigma)) return std::nullopt;
    return FuseDepths(depth, *other);
  }
  return depth;
}

std::vector<MeasuredDepth> LandmarkInitializer::Measure(std::vector<TrackId>* tracks) const {
  std::vector<MeasuredDepth> depths;
  std::erase_if(*tracks, [this](TrackId track) { return !IsReady(track); });
  std::optional<Geometry> geometry;
  if (options_.method == InitializationMethod::kTwoViewUpdate) geometry = FindGeometry(*tracks);
  for (TrackId track : *tracks) {
    const Candidate& candidate = candidates_.at(track);
    auto depth = options_.method == InitializationMethod::kMultiView
                     ? MultiView(candidate)
                     : Triangulate(candidate, ViewFromPresent(candidate.views.front()));
    if (depth && geometry) depth = Corrected(candidate, *depth, *geometry);
    if (!depth || depth->sigma > options_.max_sigma_ratio * depth->inverse_depth) continue;
    depths.push_back({track, depth->inverse_depth, depth->sigma});
  }
  std::erase_if(*tracks, [&](TrackId track) {
    return std::none_of(depths.begin(), depths.end(),
                        [&](const MeasuredDepth& d) { return d.track == track; });
  });
  return depths;
}

}  // namespace portolan
