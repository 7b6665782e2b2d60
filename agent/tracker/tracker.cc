#include "agent/tracker/tracker.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <unordered_map>

#include "absl/strings/str_cat.h"
#include "agent/tracker/image_pyramid.h"
#include "agent/tracker/patch_flow.h"
#include "agent/tracker/reference_patch.h"

namespace portolan {
namespace {

// The search from frame to frame ends at this level; the alignment with the reference does the
// rest.
constexpr int kLastFlowLevel = 1;
// A reference seen at another magnification than this is replaced.
constexpr double kMinAnchorScale = 0.65, kMaxAnchorScale = 2.5;

struct TrackState {
  TrackedPoint point;
  ReferencePatch reference;
  Eigen::Matrix2d affine = Eigen::Matrix2d::Identity();  // image from reference
};

}  // namespace

class Tracker::Impl {
 public:
  Impl(const TrackerOptions& options, const CameraModel& camera)
      : options_(options),
        camera_(camera),
        detector_(CornerDetector::Create(options.detector)),
        cell_px_(std::max(8.0, std::sqrt(static_cast<double>(camera.width_px()) *
                                         camera.height_px() / options.max_points))) {}

  void Track(const cv::Mat& gray, std::span<const TrackPrediction> predictions,
             const Eigen::Quaterniond& previous_from_current);
  std::vector<TrackId> Detect();
  void Drop(std::span<const TrackId> tracks);
  std::vector<TrackId> Reacquire(std::span<const SearchRegion> lost);
  std::vector<Feature> Describe() const;
  const std::vector<TrackedPoint>& points() const { return points_; }
  const CameraModel& camera() const { return camera_; }

 private:
  Eigen::Vector2d Rotated(const Eigen::Vector2d& pixel, const Eigen::Quaterniond& rotation) const;
  bool Advance(const Eigen::Vector2d& start, TrackState* state) const;
  bool IsUsable(const Eigen::Vector2d& pixel) const {
    return camera_.IsInImage(pixel, options_.border_px);
  }
  void Publish();
  void MergeCollapsed();
  void Lose(TrackId id, TrackState state);

  const TrackerOptions options_;
  const CameraModel camera_;
  const std::unique_ptr<CornerDetector> detector_;
  const double cell_px_;
  uint32_t next_id_ = 0;
  ImagePyramid previous_;
  ImagePyramid current_;
  std::map<TrackId, TrackState> tracks_;
  std::map<TrackId, TrackState> lost_;
  std::vector<TrackedPoint> points_;
};

Eigen::Vector2d Tracker::Impl::Rotated(const Eigen::Vector2d& pixel,
                                       const Eigen::Quaterniond& current_from_previous) const {
  const auto bearing = camera_.Unproject(pixel);
  if (!bearing) return pixel;
  return camera_.Project(current_from_previous * *bearing).value_or(pixel);
}

bool Tracker::Impl::Advance(const Eigen::Vector2d& start, TrackState* state) const {
  const Eigen::Vector2d flow =
      TrackTranslation(previous_, current_, state->point.pixel, start, kLastFlowLevel)
          .value_or(start);
  const auto aligned = state->reference.Align(current_, {flow, state->affine});
  if (!aligned || aligned->correlation < options_.min_correlation ||
      !IsUsable(aligned->pose.pixel)) {
    return false;
  }
  state->point.pixel = aligned->pose.pixel;
  state->point.sigma_px = std::hypot(options_.base_sigma_px, aligned->sigma_px);
  ++state->point.age_frames;
  state->affine = aligned->pose.affine;
  const double scale = std::sqrt(state->affine.determinant());
  if (scale < kMinAnchorScale || scale > kMaxAnchorScale) {
    if (auto reference = ReferencePatch::Create(current_, state->point.pixel)) {
      state->reference = *reference;
      state->affine.setIdentity();
    }
  }
  return true;
}

void Tracker::Impl::Track(const cv::Mat& gray, std::span<const TrackPrediction> predictions,
                          const Eigen::Quaterniond& previous_from_current) {
  std::swap(previous_, current_);
  current_.Build(gray, options_.pyramid_levels);
  std::unordered_map<TrackId, Eigen::Vector2d> predicted;
  for (const TrackPrediction& p : predictions) {
    if (p.pixel.allFinite()) predicted.emplace(p.track, p.pixel);
  }
  const Eigen::Quaterniond current_from_previous = previous_from_current.conjugate();
  for (auto it = tracks_.begin(); it != tracks_.end();) {
    TrackState& state = it->second;
    const auto prediction = predicted.find(it->first);
    const Eigen::Vector2d start = prediction != predicted.end()
                                      ? prediction->second
                                      : Rotated(state.point.pixel, current_from_previous);
    if (Advance(start, &state)) {
      ++it;
    } else {
      Lose(it->first, std::move(state));
      it = tracks_.erase(it);
    }
  }
  MergeCollapsed();
  Publish();
}

void Tracker::Impl::Lose(TrackId id, TrackState state) {
  lost_.insert_or_assign(id, std::move(state));
  while (static_cast<int>(lost_.size()) > options_.max_lost) lost_.erase(lost_.begin());
}

void Tracker::Impl::MergeCollapsed() {
  for (auto younger = tracks_.begin(); younger != tracks_.end();) {
    const bool collapsed = std::any_of(tracks_.begin(), younger, [&](const auto& older) {
      return (older.second.point.pixel - younger->second.point.pixel).norm() <
             options_.merge_distance_px;
    });
    younger = collapsed ? tracks_.erase(younger) : std::next(younger);
  }
}

void Tracker::Impl::Publish() {
  points_.clear();
  for (const auto& [id, state] : tracks_) points_.push_back(state.point);
}

std::vector<TrackId> Tracker::Impl::Detect() {
  if (current_.empty()) return {};
  const int columns = static_cast<int>(std::ceil(current_.image().cols / cell_px_));
  const int rows = static_cast<int>(std::ceil(current_.image().rows / cell_px_));
  std::vector<bool> occupied(columns * rows, false);
  for (const auto& [id, state] : tracks_) {
    const int x = std::clamp(static_cast<int>(state.point.pixel.x() / cell_px_), 0, columns - 1);
    const int y = std::clamp(static_cast<int>(state.point.pixel.y() / cell_px_), 0, rows - 1);
    occupied[y * columns + x] = true;
  }
  std::vector<Corner> chosen;
  const double min_distance = options_.min_distance_cells * cell_px_;
  for (int cell = 0; cell < columns * rows; ++cell) {
    if (occupied[cell]) continue;
    const int x0 = static_cast<int>(cell % columns * cell_px_);
    const int y0 = static_cast<int>(cell / columns * cell_px_);
    const cv::Rect rect = cv::Rect(x0, y0, std::ceil(cell_px_), std::ceil(cell_px_)) &
                          cv::Rect(0, 0, current_.image().cols, current_.image().rows);
    for (const Corner& corner : detector_->Detect(current_.image(), rect)) {
      const auto near = [&](const Eigen::Vector2d& pixel) {
        return (pixel - corner.pixel).norm() < min_distance;
      };
      if (!IsUsable(corner.pixel)) continue;
      if (std::any_of(tracks_.begin(), tracks_.end(),
                      [&](const auto& t) { return near(t.second.point.pixel); }) ||
          std::any_of(chosen.begin(), chosen.end(),
                      [&](const Corner& c) { return near(c.pixel); })) {
        continue;
      }
      chosen.push_back(corner);
      break;
    }
  }
  std::stable_sort(chosen.begin(), chosen.end(),
                   [](const Corner& a, const Corner& b) { return a.response > b.response; });
  const int room = std::max<int>(0, options_.max_points - tracks_.size());
  if (static_cast<int>(chosen.size()) > room) chosen.resize(room);
  std::vector<TrackId> created;
  for (const Corner& corner : chosen) {
    auto reference = ReferencePatch::Create(current_, corner.pixel);
    if (!reference) continue;
    const TrackId id(next_id_++);
    tracks_.emplace(id, TrackState{{id, corner.pixel, options_.base_sigma_px, 0}, *reference});
    created.push_back(id);
  }
  Publish();
  return created;
}

void Tracker::Impl::Drop(std::span<const TrackId> tracks) {
  for (const TrackId& id : tracks) tracks_.erase(id);
  Publish();
}

std::vector<TrackId> Tracker::Impl::Reacquire(std::span<const SearchRegion> lost) {
  std::vector<TrackId> revived;
  for (const SearchRegion& region : lost) {
    const auto it = lost_.find(region.track);
    if (it == lost_.end() || !region.pixel.allFinite()) continue;
    const auto aligned = it->second.reference.Align(current_, {region.pixel, it->second.affine});
    if (!aligned || aligned->correlation < options_.min_reacquire_correlation) continue;
    TrackState state = std::move(it->second);
    lost_.erase(it);
    state.point.pixel = aligned->pose.pixel;
    state.affine = aligned->pose.affine;
    tracks_.insert_or_assign(region.track, std::move(state));
    revived.push_back(region.track);
  }
  std::sort(revived.begin(), revived.end());
  Publish();
  return revived;
}

std::vector<Feature> Tracker::Impl::Describe() const {
  std::vector<Eigen::Vector2d> pixels;
  for (const TrackedPoint& point : points_) pixels.push_back(point.pixel);
  const auto described = ExtractFeatures(current_.image(), pixels, options_.features);
  if (!described.ok()) return {};
  std::vector<Feature> features;
  for (const DescribedPoint& point : *described) {
    Feature feature;
    feature.pixel = point.pixel.cast<float>();
    feature.half_octave = point.half_octave;
    if (point.point_index >= 0) feature.track = points_[point.point_index].track;
    feature.descriptor = point.descriptor;
    features.push_back(feature);
  }
  return features;
}

Status TrackerOptions::Validate() const {
  if (max_points < 1 || max_points > 5000) {
    return absl::InvalidArgumentError("max_points must be in [1, 5000]");
  }
  if (!(min_distance_cells >= 0.0 && min_distance_cells <= 1.0)) {
    return absl::InvalidArgumentError("min_distance_cells must be in [0, 1]");
  }
  if (!(border_px >= 8.0)) return absl::InvalidArgumentError("border_px must be at least 8");
  if (!(merge_distance_px >= 0.0)) {
    return absl::InvalidArgumentError("merge_distance_px must be >= 0");
  }
  if (!(min_correlation > 0.0 && min_correlation < 1.0)) {
    return absl::InvalidArgumentError("min_correlation must be in (0, 1)");
  }
  if (!(min_reacquire_correlation > 0.0 && min_reacquire_correlation < 1.0)) {
    return absl::InvalidArgumentError("min_reacquire_correlation must be in (0, 1)");
  }
  if (pyramid_levels < 0 || pyramid_levels > 8) {
    return absl::InvalidArgumentError("pyramid_levels must be in [0, 8]");
  }
  if (!(base_sigma_px > 0.0)) return absl::InvalidArgumentError("base_sigma_px must be > 0");
  if (max_lost < 0) return absl::InvalidArgumentError("max_lost must be >= 0");
  PORTOLAN_RETURN_IF_ERROR(detector.Validate());
  return features.Validate();
}

StatusOr<std::unique_ptr<Tracker>> Tracker::Create(const TrackerOptions& options,
                                                   const CameraModel& camera) {
  PORTOLAN_RETURN_IF_ERROR(options.Validate());
  return std::unique_ptr<Tracker>(new Tracker(std::make_unique<Impl>(options, camera)));
}

Tracker::Tracker(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Tracker::~Tracker() = default;

Status Tracker::Track(const cv::Mat& gray, std::span<const TrackPrediction> predictions,
                      const Eigen::Quaterniond& previous_from_current) {
  const CameraModel& camera = impl_->camera();
  if (gray.type() != CV_8UC1 || gray.cols != camera.width_px() || gray.rows != camera.height_px()) {
    return absl::InvalidArgumentError(
        absl::StrCat("image is ", gray.cols, " x ", gray.rows, " of type ", gray.type(),
                     ", expected 8-bit grey, ", camera.width_px(), " x ", camera.height_px()));
  }
  impl_->Track(gray, predictions, previous_from_current);
  return absl::OkStatus();
}

std::vector<TrackId> Tracker::Detect() { return impl_->Detect(); }
void Tracker::Drop(std::span<const TrackId> tracks) { impl_->Drop(tracks); }
std::vector<TrackId> Tracker::Reacquire(std::span<const SearchRegion> lost) {
  return impl_->Reacquire(lost);
}
const std::vector<TrackedPoint>& Tracker::points() const { return impl_->points(); }
std::vector<Feature> Tracker::Describe() const { return impl_->Describe(); }

}  // namespace portolan
