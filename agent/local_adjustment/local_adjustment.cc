#include "agent/local_adjustment/local_adjustment.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <utility>

#include "common/base/check.h"
#include "common/bundle/bundle_parameters.h"
#include "common/bundle/bundle_solver.h"

namespace portolan {
namespace {

// Keyframes over which units of length are compared.
constexpr size_t kScaleKeyframes = 8;

// Root mean square distance of the positions from their mean.
template <typename Poses, typename Position>
double Spread(const Poses& poses, size_t first, const Position& position) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  const double count = static_cast<double>(poses.size() - first);
  for (size_t i = first; i < poses.size(); ++i) mean += position(poses[i]) / count;
  double sum = 0;
  for (size_t i = first; i < poses.size(); ++i) {
    sum += (position(poses[i]) - mean).squaredNorm() / count;
  }
  return std::sqrt(sum);
}

size_t FirstOfLast(size_t size, size_t count) { return size > count ? size - count : 0; }

Rigid3 Scaled(const Rigid3& pose, double scale) {
  return {pose.rotation, scale * pose.translation};
}

DepthPoint Transformed(const Similarity3& new_from_old, const DepthPoint& point) {
  const double inverse_scale = 1 / new_from_old.scale;
  return {{new_from_old * point.reference.anchor_in_world,
           new_from_old.rotation.toRotationMatrix() * point.reference.axes},
          inverse_scale * point.inverse_depth,
          inverse_scale * inverse_scale * point.inverse_depth_variance};
}

}  // namespace

Status LocalAdjustmentOptions::Validate() const {
  PORTOLAN_RETURN_IF_ERROR(bundle.Validate());
  PORTOLAN_RETURN_IF_ERROR(triangulation.Validate());
  PORTOLAN_RETURN_IF_ERROR(resection.Validate());
  PORTOLAN_RETURN_IF_ERROR(known_fit.Validate());
  if (max_free_keyframes < 1 || max_keyframes <= max_free_keyframes ||
      max_kept_keyframes < max_keyframes || max_free_after_correction < max_free_keyframes ||
      max_start_iterations < 1 || free_corrected < 0 || min_points < 4 || max_lens_windows < 0 ||
      !(lens_corner_sigma_px > 0) || !(lens_noise_factor >= 1) || !(readout_sigma_s >= 0)) {
    return absl::InvalidArgumentError("local_adjustment: a limit is out of range");
  }
  return absl::OkStatus();
}

LocalAdjustment::LocalAdjustment(const LocalAdjustmentOptions& options, const CameraModel& camera)
    : options_(options),
      calibration_(camera),
      camera_(camera),
      lens_(MakeLens(std::make_shared<const CameraModel>(camera), camera,
                     options.lens_corner_sigma_px,
                     std::max(options.readout_sigma_s, kHeldReadoutSigma_s))),
      lens_is_known_(options.trust_distortion && camera.has_distortion()),
      readout_is_known_(options.readout_sigma_s == 0) {}

void LocalAdjustment::Start() {
  keyframes_.clear();
  points_.clear();
  scale_ = 1;
  in_world_ = false;
  followed_ = {};
  odometry_from_camera_.reset();
}

Rigid3 LocalAdjustment::Locate(const Rigid3& odometry_from_camera,
                               std::span<const LiveSight> sights) {
  if (odometry_from_camera_) {
    const Rigid3 motion = odometry_from_camera_->Inverse() * odometry_from_camera;
    window_from_camera_ = window_from_camera_ * Scaled(motion, scale_);
  } else {
    window_from_camera_ = odometry_from_camera;
  }
  odometry_from_camera_ = odometry_from_camera;
  sights_.assign(sights.begin(), sights.end());
  if (static_cast<int>(points_.size()) >= options_.min_points) FitToPoints();
  return window_from_camera_;
}

// From the sights that the filter has found consistent, then with all that fit these. The others
// are not to be believed any more: flow that slips onto a similar texture goes on with it.
void LocalAdjustment::FitToPoints() {
  std::vector<PointSight> known, trusted;
  std::vector<int> index_of;  // in known, by sight; -1 without a point
  for (const LiveSight& sight : sights_) {
    const WindowPoint* point = FindPoint(sight.observation.track);
    index_of.push_back(point == nullptr ? -1 : static_cast<int>(known.size()));
    if (point == nullptr) continue;
    known.push_back({&point->seen_from_last, PixelOf(sight), double{sight.observation.sigma_px}});
    if (sight.trusted) trusted.push_back(known.back());
  }
  auto pose = Resect(options_.resection, camera_, trusted, window_from_camera_);
  if (!pose) pose = Resect(options_.resection, camera_, known, window_from_camera_);
  std::vector<bool> fits(known.size(), false);
  if (pose) {
    const CameraReference camera{*pose, &camera_};
    const CameraState state(camera);
    std::vector<PointSight> fitting;
    for (size_t i = 0; i < known.size(); ++i) {
      fits[i] = SightChi2(state, known[i]) < options_.resection.outlier_chi2;
      if (fits[i]) fitting.push_back(known[i]);
    }
    pose = Resect(options_.resection, camera_, fitting, *pose);
  }
  if (pose) window_from_camera_ = *pose;
  std::vector<LiveSight> believed;
  for (size_t i = 0; i < sights_.size(); ++i) {
    const int index = index_of[i];
    if (index < 0 || (pose ? fits[index] : sights_[i].trusted)) believed.push_back(sights_[i]);
  }
  sights_ = std::move(believed);
}

const LocalAdjustment::WindowPoint* LocalAdjustment::FindPoint(TrackId track) const {
  const auto at =
      std::lower_bound(points_.begin(), points_.end(), track,
                       [](const WindowPoint& point, TrackId id) { return point.track < id; });
  return at == points_.end() || at->track != track ? nullptr : &*at;
}

void LocalAdjustment::AddKeyframe(Timestamp time, std::vector<KnownSight> known) {
  PORTOLAN_CHECK(odometry_from_camera_.has_value());
  if (static_cast<int>(keyframes_.size()) == options_.max_kept_keyframes) {
    keyframes_.erase(keyframes_.begin());
  }
  keyframes_.push_back(
      {time, *odometry_from_camera_, window_from_camera_, sights_, false, std::move(known)});
  if (!keyframes_.back().known.empty()) FollowKnown();
  // A start is far from converged.
  const bool is_start = static_cast<int>(keyframes_.size()) <= options_.max_keyframes;
  if (++keyframes_since_lens_ >= options_.max_keyframes && !is_start &&
      lens_windows_ < options_.max_lens_windows &&
      !(lens_is_known_ && (readout_is_known_ || in_world_))) {
    AdjustLens();
  }
  Adjust(options_.max_free_keyframes,
         is_start ? options_.max_start_iterations : options_.bundle.max_iterations);
}

void LocalAdjustment::Restate(const Rigid3& odometry_from_submap, std::span<const FramePose> frames,
                              Timestamp last_located) {
  const auto restate = [&](Timestamp time, Rigid3* odometry_from_camera) {
    const auto at = std::lower_bound(
        frames.begin(), frames.end(), time,
        [](const FramePose& frame, Timestamp wanted) { return frame.time < wanted; });
    if (at == frames.end() || at->time != time) return;
    *odometry_from_camera = odometry_from_submap * at->submap_from_camera;
  };
  for (WindowKeyframe& keyframe : keyframes_) {
    restate(keyframe.time, &keyframe.odometry_from_camera);
  }
  if (odometry_from_camera_) restate(last_located, &*odometry_from_camera_);
  MeasureScale();
}

void LocalAdjustment::SetRowMotion(TrackId track, const Eigen::Vector2f& row_motion) {
  if (keyframes_.empty()) return;
  std::vector<LiveSight>& sights = keyframes_.back().sights;
  const auto at = std::lower_bound(
      sights.begin(), sights.end(), track,
      [](const LiveSight& sight, TrackId wanted) { return sight.observation.track < wanted; });
  if (at != sights.end() && at->observation.track == track) at->row_motion = row_motion;
}

bool LocalAdjustment::Hold(std::span<const KeyframePose> keyframes, const PositionOf& position_of) {
  std::vector<std::pair<size_t, Rigid3>> common;
  for (const KeyframePose& held : keyframes) {
    const auto at = std::lower_bound(
        keyframes_.begin(), keyframes_.end(), held.time,
        [](const WindowKeyframe& keyframe, Timestamp time) { return keyframe.time < time; });
    if (at == keyframes_.end() || at->time != held.time) continue;
    common.emplace_back(at - keyframes_.begin(), held.window_from_camera);
  }
  if (common.size() < 2) return false;
  const size_t first = FirstOfLast(common.size(), kScaleKeyframes);
  const double before = Spread(common, first, [this](const auto& pair) {
    return keyframes_[pair.first].window_from_camera.translation;
  });
  const double after =
      Spread(common, first, [](const auto& pair) { return pair.second.translation; });
  const double scale = before > 0 && after > 0 ? after / before : 1;
  const Similarity3 new_from_old =
      Similarity3::FromRigid(common.back().second, scale) *
      Similarity3::FromRigid(keyframes_[common.back().first].window_from_camera).Inverse();
  Move(new_from_old);
  for (WindowKeyframe& keyframe : keyframes_) {
    keyframe.held = false;
    std::erase_if(keyframe.known, [&](KnownSight& sight) {
      const auto position = position_of ? position_of(sight.landmark) : std::nullopt;
      if (position) sight.point_in_world = *position;
      return !position;
    });
  }
  // Half of them at least, or the unit of length would hang on two neighbours of a short submap.
  const size_t held =
      std::max((common.size() + 1) / 2,
               FirstOfLast(common.size(), static_cast<size_t>(options_.free_corrected)));
  for (size_t i = 0; i < common.size(); ++i) {
    const auto& [index, pose] = common[i];
    keyframes_[index].window_from_camera = pose;
    keyframes_[index].held = i < held;
  }
  keyframes_.erase(keyframes_.begin(),
                   keyframes_.begin() + static_cast<std::ptrdiff_t>(common.front().first));
  in_world_ = true;
  followed_ = {};
  FollowKnown();
  const Rigid3 last_from_camera =
      keyframes_.back().window_from_camera.Inverse() * window_from_camera_;
  Adjust(options_.max_free_after_correction, options_.max_start_iterations);
  window_from_camera_ = keyframes_.back().window_from_camera * last_from_camera;
  return true;
}

void LocalAdjustment::Move(const Similarity3& new_from_old) {
  for (WindowKeyframe& keyframe : keyframes_) {
    keyframe.window_from_camera = new_from_old * keyframe.window_from_camera;
  }
  for (WindowPoint& point : points_) {
    point.point_in_window = new_from_old * point.point_in_window;
    point.seen_from_last = Transformed(new_from_old, point.seen_from_last);
  }
  scale_ *= new_from_old.scale;
  window_from_camera_ = new_from_old * window_from_camera_;
}

void LocalAdjustment::FollowKnown() {
  std::vector<KnownView> views;
  const size_t size = keyframes_.size();
  for (size_t i = FirstOfLast(size, options_.max_keyframes); i < size; ++i) {
    for (const KnownSight& sight : keyframes_[i].known) {
      views.push_back({keyframes_[i].window_from_camera, &sight});
    }
  }
  const auto new_from_old = FitToKnown(options_.known_fit, camera_, views, SceneDepth(), followed_);
  if (!new_from_old) return;
  Move(*new_from_old);
  followed_ = *new_from_old * followed_;
}

std::vector<LocalAdjustment::KeyframePose> LocalAdjustment::Keyframes() const {
  std::vector<KeyframePose> poses;
  for (const WindowKeyframe& keyframe : keyframes_) {
    poses.push_back({keyframe.time, keyframe.window_from_camera});
  }
  return poses;
}

void LocalAdjustment::Adjust(int max_free, int max_iterations) {
  if (keyframes_.size() < 2) return;
  const size_t size = keyframes_.size();
  const size_t held = static_cast<size_t>(options_.max_keyframes - options_.max_free_keyframes);
  size_t first_free = FirstOfLast(size, static_cast<size_t>(max_free));
  while (first_free < size && keyframes_[first_free].held) ++first_free;
  first_free = std::max<size_t>(first_free, 1);
  const size_t first = FirstOfLast(first_free, held);

  BundleProblem problem;
  const std::vector<TrackId> tracks =
      MakeProblem(static_cast<int>(first), static_cast<int>(first_free), &problem);
  if (tracks.empty()) return;
  AddKnown(static_cast<int>(first), static_cast<int>(first_free), &problem);
  BundleOptions bundle = options_.bundle;
  bundle.max_iterations = max_iterations;
  BundleParameters parameters(problem);
  if (first_free < size && SolveBundle(bundle, problem, nullptr, &parameters).usable) {
    parameters.WriteTo(bundle, &problem);
  }
  TakeResult(problem, tracks, static_cast<int>(first));
  MeasureScale();
}

void LocalAdjustment::TakeResult(const BundleProblem& problem, const std::vector<TrackId>& tracks,
                                 int first) {
  for (size_t i = 0; i < problem.cameras.size(); ++i) {
    if (problem.cameras[i].fixed) continue;
    keyframes_[static_cast<size_t>(first) + i].window_from_camera =
        problem.cameras[i].world_from_camera;
  }
  window_from_camera_ = keyframes_.back().window_from_camera;
  points_.clear();
  std::vector<CameraReference> cameras;
  for (const BundleCamera& camera : problem.cameras) {
    cameras.push_back({camera.world_from_camera, camera.model});
  }
  const std::vector<CameraState> states(cameras.begin(), cameras.end());
  const double prior_sigma = options_.bundle.inverse_depth_prior_of_median / MedianDepth(problem);
  size_t begin = 0;
  for (size_t i = 0; i < tracks.size(); ++i) {
    size_t end = begin;
    while (end < problem.observations.size() &&
           problem.observations[end].point == static_cast<int>(i)) {
      ++end;
    }
    WindowPoint point;
    point.track = tracks[i];
    point.point_in_window = problem.points[i].point_in_world;
    MeasureDepth(std::span(problem.observations).subspan(begin, end - begin), states, prior_sigma,
                 &point);
    if (point.seen_from_last.inverse_depth > 0) points_.push_back(point);
    begin = end;
  }
}

// How well the sights tell the point's inverse distance from the last keyframe; the keyframes'
// errors are not counted. A point without inliers gets no inverse depth.
void LocalAdjustment::MeasureDepth(std::span<const BundleObservation> observations,
                                   const std::vector<CameraState>& cameras, double prior_sigma,
                                   WindowPoint* point) const {
  DepthPoint& depth = point->seen_from_last;
  const Eigen::Vector3d anchor = keyframes_.back().window_from_camera.translation;
  const Eigen::Vector3d bearing = point->point_in_window - anchor;
  if (!(bearing.norm() > 0) || !bearing.allFinite()) return;
  depth.reference = PointReference::At(anchor, point->point_in_window);
  const std::array<double, 3> parameters = {0, 0, 1 / bearing.norm()};
  double information = 1 / (prior_sigma * prior_sigma);
  int inliers = 0;
  for (const BundleObservation& observation : observations) {
    Eigen::Vector2d residual;
    Eigen::Matrix<double, 2, 3, Eigen::RowMajor> d_point;
    ReprojectionError(&depth.reference, observation.pixel, observation.sigma_px)
        .Evaluate(cameras[observation.camera], parameters.data(), residual.data(), nullptr,
                  d_point.data());
    if (!(residual.squaredNorm() < options_.bundle.outlier_chi2)) continue;
    information += d_point.col(2).squaredNorm();
    ++inliers;
  }
  if (inliers < 2) return;
  depth.inverse_depth = parameters[2];
  depth.inverse_depth_variance = 1 / information;
}

void LocalAdjustment::MeasureScale() {
  const size_t first = FirstOfLast(keyframes_.size(), kScaleKeyframes);
  const double odometry = Spread(keyframes_, first, [](const WindowKeyframe& keyframe) {
    return keyframe.odometry_from_camera.translation;
  });
  const double window = Spread(keyframes_, first, [](const WindowKeyframe& keyframe) {
    return keyframe.window_from_camera.translation;
  });
  if (odometry > 0 && window > 0) scale_ = window / odometry;
}

double LocalAdjustment::SceneDepth() const {
  std::vector<double> inverse_depths;
  for (const WindowPoint& point : points_) {
    inverse_depths.push_back(point.seen_from_last.inverse_depth);
  }
  if (inverse_depths.empty()) return 1;
  const auto middle =
      inverse_depths.begin() + static_cast<std::ptrdiff_t>(inverse_depths.size() / 2);
  std::nth_element(inverse_depths.begin(), middle, inverse_depths.end());
  return 1 / *middle;
}

}  // namespace portolan
