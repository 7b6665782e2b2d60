#include "agent/tracker/tracker.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <unordered_map>

#include "absl/strings/str_cat.h"
#include "common/base/check.h"

namespace portolan {
namespace {

constexpr int kPatchPx = 13;
const cv::Size kLkWindow(15, 15);

cv::Mat PatchAt(const cv::Mat& gray, const Eigen::Vector2d& pixel) {
  cv::Mat patch;
  cv::getRectSubPix(gray, cv::Size(kPatchPx, kPatchPx), cv::Point2f(pixel.x(), pixel.y()), patch);
  return patch;
}

double Correlation(const cv::Mat& a, const cv::Mat& b) {
  cv::Mat score;
  cv::matchTemplate(a, b, score, cv::TM_CCOEFF_NORMED);
  return score.at<float>(0, 0);
}

}  // namespace

class Tracker::Impl {
 public:
  struct State {
    TrackedPoint point;
    cv::Mat patch;
  };

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
  std::vector<cv::Point2f> Starts(std::span<const TrackPrediction> predictions,
                                  const Eigen::Quaterniond& previous_from_current) const;
  bool IsUsable(const Eigen::Vector2d& pixel) const {
    return camera_.IsInImage(pixel, options_.border_px);
  }
  void Publish();
  void MergeCollapsed();
  void Lose(TrackId id, State state);

  const TrackerOptions options_;
  const CameraModel camera_;
  const std::unique_ptr<CornerDetector> detector_;
  const double cell_px_;
  uint32_t next_id_ = 0;
  cv::Mat gray_;
  std::vector<cv::Mat> pyramid_;
  std::map<TrackId, State> tracks_;
  std::map<TrackId, State> lost_;
  std::vector<TrackedPoint> points_;
};

Eigen::Vector2d Tracker::Impl::Rotated(const Eigen::Vector2d& pixel,
                                       const Eigen::Quaterniond& current_from_previous) const {
  const auto bearing = camera_.Unproject(pixel);
  if (!bearing) return pixel;
  return camera_.Project(current_from_previous * *bearing).value_or(pixel);
}

std::vector<cv::Point2f> Tracker::Impl::Starts(
    std::span<const TrackPrediction> predictions,
    const Eigen::Quaterniond& previous_from_current) const {
  std::unordered_map<TrackId, Eigen::Vector2d> predicted;
  for (const TrackPrediction& p : predictions) {
    if (p.pixel.allFinite()) predicted.emplace(p.track, p.pixel);
  }
  const Eigen::Quaterniond current_from_previous = previous_from_current.conjugate();
  std::vector<cv::Point2f> starts;
  for (const auto& [id, state] : tracks_) {
    const auto it = predicted.find(id);
    const Eigen::Vector2d start =
        it != predicted.end() ? it->second : Rotated(state.point.pixel, current_from_previous);
    starts.emplace_back(start.x(), start.y());
  }
  return starts;
}

void Tracker::Impl::Track(const cv::Mat& gray, std::span<const TrackPrediction> predictions,
                          const Eigen::Quaterniond& previous_from_current) {
  gray_ = gray.clone();
  std::vector<cv::Mat> pyramid;
  cv::buildOpticalFlowPyramid(gray_, pyramid, kLkWindow, options_.pyramid_levels, true);
  if (!tracks_.empty()) {
    std::vector<cv::Point2f> from, to = Starts(predictions, previous_from_current);
    for (const auto& [id, state] : tracks_) {
      from.emplace_back(state.point.pixel.x(), state.point.pixel.y());
    }
    std::vector<uint8_t> found;
    std::vector<float> error;
    cv::calcOpticalFlowPyrLK(
        pyramid_, pyramid, from, to, found, error, kLkWindow, options_.pyramid_levels,
        cv::TermCriteria(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 20, 0.01),
        cv::OPTFLOW_USE_INITIAL_FLOW);
    size_t i = 0;
    for (auto it = tracks_.begin(); it != tracks_.end(); ++i) {
      State& state = it->second;
      const Eigen::Vector2d pixel(to[i].x, to[i].y);
      if (found[i] && IsUsable(pixel)) {
        const cv::Mat patch = PatchAt(gray_, pixel);
        if (Correlation(patch, state.patch) > 0.6) {
          state.point.pixel = pixel;
          ++state.point.age_frames;
          state.patch = patch;
          ++it;
          continue;
        }
      }
      Lose(it->first, std::move(state));
      it = tracks_.erase(it);
    }
  }
  pyramid_ = std::move(pyramid);
  MergeCollapsed();
  Publish();
}

void Tracker::Impl::Lose(TrackId id, State state) {
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
  if (gray_.empty()) return {};
  const int columns = static_cast<int>(std::ceil(gray_.cols / cell_px_));
  const int rows = static_cast<int>(std::ceil(gray_.rows / cell_px_));
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
                          cv::Rect(0, 0, gray_.cols, gray_.rows);
    for (const Corner& corner : detector_->Detect(gray_, rect)) {
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
    const TrackId id(next_id_++);
    State state;
    state.point = {id, corner.pixel, options_.base_sigma_px, 0};
    state.patch = PatchAt(gray_, corner.pixel);
    tracks_.emplace(id, std::move(state));
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
    const double reach = std::min(30.0, 3.0 * std::sqrt(region.covariance_px2.trace()));
    const int half = static_cast<int>(std::ceil(reach)) + kPatchPx / 2;
    const cv::Rect window = cv::Rect(cvRound(region.pixel.x()) - half,
                                     cvRound(region.pixel.y()) - half, 2 * half + 1, 2 * half + 1) &
                            cv::Rect(0, 0, gray_.cols, gray_.rows);
    if (window.width < kPatchPx || window.height < kPatchPx) continue;
    cv::Mat score;
    cv::matchTemplate(gray_(window), it->second.patch, score, cv::TM_CCOEFF_NORMED);
    double best = 0.0;
    cv::Point where;
    cv::minMaxLoc(score, nullptr, &best, nullptr, &where);
    const Eigen::Vector2d pixel(window.x + where.x + kPatchPx / 2,
                                window.y + where.y + kPatchPx / 2);
    if (best < options_.min_reacquire_correlation || !IsUsable(pixel)) continue;
    State state = std::move(it->second);
    lost_.erase(it);
    state.point.pixel = pixel;
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
  const auto described = ExtractFeatures(gray_, pixels, options_.features);
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
