#include "agent/tracker/tracker.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <unordered_map>
#include <utility>

#include "absl/strings/str_cat.h"
#include "agent/tracker/detection_grid.h"
#include "agent/tracker/image_pyramid.h"
#include "agent/tracker/patch_flow.h"
#include "agent/tracker/patch_search.h"
#include "agent/tracker/pixel_list.h"
#include "agent/tracker/reference_patch.h"
#include "agent/tracker/track_motion.h"
#include "common/base/keep_latest.h"

namespace portolan {
namespace {

// The search from frame to frame ends at this level; the alignment with the reference does the
// rest.
constexpr int kLastFlowLevel = 1;
// A reference seen at another magnification than this is replaced.
constexpr double kMinAnchorScale = 0.65, kMaxAnchorScale = 2.5;

// How much larger errors are than a residual of independent grey values would have them.
constexpr double kSigmaInflation = 2.0;

// Where so many tracks of known places, and such a share of them, slip onto something similar,
// those of unknown places are not believed either.
constexpr int kMinSuspicious = 6;
constexpr double kSuspiciousShare = 0.1;

struct TrackState {
  TrackedPoint point;
  ReferencePatch reference;
  Eigen::Matrix2d affine = Eigen::Matrix2d::Identity();  // image from reference
  // How it moved in the last image beyond the camera's rotation.
  Eigen::Vector2d last_shift = Eigen::Vector2d::Zero();
  // Number of the image in which it was not found.
  int lost_at = 0;
  // Number of the image that its pixel is in.
  int image = 0;
};

// Where a track is searched for.
struct Expectation {
  Eigen::Vector2d pixel;
  Eigen::Matrix2d covariance_px2;
};

int MaxPoints(const TrackerOptions& options, const CameraModel& camera) {
  const double area = static_cast<double>(camera.width_px()) * camera.height_px();
  const double fit = area / (options.min_spacing_px * options.min_spacing_px);
  return std::max(1, static_cast<int>(std::min<double>(options.max_points, fit)));
}

}  // namespace

class Tracker::Impl {
 public:
  Impl(const TrackerOptions& options, const CameraModel& camera)
      : options_(options),
        camera_(camera),
        max_points_(MaxPoints(options, camera)),
        grid_({.width_px = camera.width_px(),
               .height_px = camera.height_px(),
               .target_corners = max_points_,
               .min_distance_share = options.min_distance_share,
               .border_px = options.border_px},
              CornerDetector::Create(options.detector)) {}

  void TrackPredicted(const cv::Mat& gray, std::span<const TrackPrediction> predictions,
                      const Eigen::Quaterniond& previous_from_current);
  void TrackOthers(std::span<const TrackPrediction> predictions,
                   const Eigen::Quaterniond& previous_from_current);
  std::vector<TrackId> Detect();
  std::optional<TrackId> StartAt(const Eigen::Vector2d& pixel);
  void Drop(std::span<const TrackId> tracks);
  std::vector<TrackId> Reacquire(std::span<const SearchRegion> lost);
  std::vector<Feature> Describe(bool complete) const;
  const std::vector<TrackedPoint>& points() const { return points_; }
  const CameraModel& camera() const { return camera_; }
  int max_points() const { return max_points_; }
  std::vector<TrackId> lost() const {
    std::vector<TrackId> ids;
    for (const auto& [id, state] : lost_) ids.push_back(id);
    return ids;
  }

 private:
  using TrackMap = std::map<TrackId, TrackState>;

  Eigen::Vector2d Rotated(const Eigen::Vector2d& pixel,
                          const Eigen::Quaterniond& current_from_previous) const;
  // Where the track is in the current image: by flow from the best of the starts, or by search.
  std::optional<PatchAlignment> Find(std::span<const Eigen::Vector2d> starts,
                                     const Expectation& expected, const TrackState& state) const;
  // The tracks with a prediction at first, then all that are not in the image yet.
  void Move(std::span<const TrackPrediction> predictions,
            const Eigen::Quaterniond& previous_from_current, bool first);
  bool IsNear(const Eigen::Vector2d& pixel, const Expectation& expected) const;
  enum class Outcome { kFound, kSlipped, kLost };
  // is_bound: what is found elsewhere than expected is another point.
  Outcome Advance(std::span<const Eigen::Vector2d> starts, const Expectation& expected,
                  bool is_bound, TrackState* state) const;
  void Accept(const PatchAlignment& aligned, TrackState* state) const;
  bool IsUsable(const Eigen::Vector2d& pixel) const {
    return camera_.IsInImage(pixel, options_.border_px);
  }
  // Keeps their patches, of all lost tracks the latest.
  void Lose(const std::vector<TrackMap::iterator>& lost);
  void DropCollapsed();
  void Publish();

  const TrackerOptions options_;
  const CameraModel camera_;
  const int max_points_;
  DetectionGrid grid_;
  uint32_t next_id_ = 0;
  int image_count_ = 0;
  ImagePyramid previous_;
  ImagePyramid current_;
  TrackMap tracks_;
  TrackMap lost_;
  std::vector<TrackedPoint> points_;
  // In the current image.
  std::vector<TrackMotion> motions_;
  PixelList kept_;
};

Eigen::Vector2d Tracker::Impl::Rotated(const Eigen::Vector2d& pixel,
                                       const Eigen::Quaterniond& current_from_previous) const {
  // Also keeps the pixel exact where it is on the rim of an inexact distortion model.
  if (current_from_previous.vec().squaredNorm() == 0.0) return pixel;
  const auto bearing = camera_.Unproject(pixel);
  if (!bearing) return pixel;
  return camera_.Project(current_from_previous * *bearing).value_or(pixel);
}

std::optional<PatchAlignment> Tracker::Impl::Find(std::span<const Eigen::Vector2d> starts,
                                                  const Expectation& expected,
                                                  const TrackState& state) const {
  if (options_.matcher == MatcherType::kActiveSearch) {
    return SearchPatch(current_, state.reference, {expected.pixel, state.affine},
                       expected.covariance_px2, {.min_correlation = options_.min_correlation});
  }
  const Eigen::Vector2d flow =
      TrackTranslation(previous_, current_, state.point.pixel, starts, kLastFlowLevel)
          .value_or(starts.front());
  return state.reference.Align(current_, {flow, state.affine});
}

Tracker::Impl::Outcome Tracker::Impl::Advance(std::span<const Eigen::Vector2d> starts,
                                              const Expectation& expected, bool is_bound,
                                              TrackState* state) const {
  const auto aligned = Find(starts, expected, *state);
  if (!aligned || aligned->correlation < options_.min_correlation ||
      !IsUsable(aligned->pose.pixel)) {
    return Outcome::kLost;
  }
  if (is_bound && !IsNear(aligned->pose.pixel, expected)) return Outcome::kSlipped;
  Accept(*aligned, state);
  ++state->point.age_frames;
  return Outcome::kFound;
}

void Tracker::Impl::Accept(const PatchAlignment& aligned, TrackState* state) const {
  state->point.pixel = aligned.pose.pixel;
  state->image = image_count_;
  state->point.sigma_px = std::hypot(options_.base_sigma_px, kSigmaInflation * aligned.sigma_px);
  state->affine = aligned.pose.affine;
  const double scale = std::sqrt(state->affine.determinant());
  if (scale > kMinAnchorScale && scale < kMaxAnchorScale) return;
  if (auto reference = ReferencePatch::Create(current_, state->point.pixel)) {
    state->reference = *reference;
    state->affine.setIdentity();
  }
}

void Tracker::Impl::TrackPredicted(const cv::Mat& gray,
                                   std::span<const TrackPrediction> predictions,
                                   const Eigen::Quaterniond& previous_from_current) {
  std::swap(previous_, current_);
  current_.Build(gray, options_.pyramid_levels);
  ++image_count_;
  motions_.clear();
  Move(predictions, previous_from_current, true);
}

void Tracker::Impl::TrackOthers(std::span<const TrackPrediction> predictions,
                                const Eigen::Quaterniond& previous_from_current) {
  Move(predictions, previous_from_current, false);
}

void Tracker::Impl::Move(std::span<const TrackPrediction> predictions,
                         const Eigen::Quaterniond& previous_from_current, bool first) {
  std::unordered_map<TrackId, const TrackPrediction*> predicted;
  for (const TrackPrediction& p : predictions) {
    if (p.pixel.allFinite()) predicted.emplace(p.track, &p);
  }
  const Eigen::Matrix2d unknown =
      options_.search_sigma_px * options_.search_sigma_px * Eigen::Matrix2d::Identity();
  const Eigen::Quaterniond current_from_previous = previous_from_current.conjugate();
  std::vector<TrackMap::iterator> failed, lost, unpredicted;
  int tested = 0, slipped = 0;
  std::vector<Eigen::Vector2d> starts;
  for (auto it = tracks_.begin(); it != tracks_.end(); ++it) {
    TrackState& state = it->second;
    const auto prediction = predicted.find(it->first);
    const bool is_predicted = prediction != predicted.end();
    if (state.image == image_count_ || (first && !is_predicted)) continue;
    if (!is_predicted) unpredicted.push_back(it);
    const bool is_bound = is_predicted && !first;
    const Eigen::Vector2d from = state.point.pixel;
    const Eigen::Vector2d turned = Rotated(from, current_from_previous);
    starts.clear();
    if (is_predicted) starts.push_back(prediction->second->pixel);
    if (!is_bound) starts.push_back(turned);
    if (!is_bound && state.point.age_frames > 0) starts.push_back(turned + state.last_shift);
    const Expectation expected =
        is_predicted ? Expectation{starts.front(), prediction->second->covariance_px2}
                     : Expectation{starts.back(), unknown};
    const Outcome outcome = Advance(starts, expected, is_bound, &state);
    tested += is_bound ? 1 : 0;
    slipped += outcome == Outcome::kSlipped ? 1 : 0;
    if (outcome == Outcome::kFound) {
      state.last_shift = state.point.pixel - turned;
      motions_.push_back({from, state.last_shift});
    } else {
      (is_bound ? lost : failed).push_back(it);
    }
  }
  if (slipped >= kMinSuspicious && slipped > kSuspiciousShare * tested) {
    lost.insert(lost.end(), unpredicted.begin(), unpredicted.end());
    failed.clear();
  }
  // What was not found from its own start is tried where its neighbours went.
  for (const TrackMap::iterator it : failed) {
    TrackState& state = it->second;
    const auto shift = LocalMotion(motions_, state.point.pixel);
    if (shift) starts = {Rotated(state.point.pixel, current_from_previous) + *shift};
    if (shift && Advance(starts, {starts.front(), unknown}, false, &state) == Outcome::kFound) {
      state.last_shift = *shift;
    } else {
      lost.push_back(it);
    }
  }
  Lose(lost);
  DropCollapsed();
  Publish();
}

bool Tracker::Impl::IsNear(const Eigen::Vector2d& pixel, const Expectation& expected) const {
  const Eigen::Vector2d error = pixel - expected.pixel;
  return error.norm() < options_.gate_px ||
         error.dot(expected.covariance_px2.inverse() * error) < 9.0;
}

void Tracker::Impl::Lose(const std::vector<TrackMap::iterator>& lost) {
  for (const TrackMap::iterator it : lost) {
    it->second.lost_at = image_count_;
    lost_.insert_or_assign(it->first, std::move(it->second));
    tracks_.erase(it);
  }
  KeepLatest(options_.max_lost, &TrackState::lost_at, &lost_);
}

void Tracker::Impl::DropCollapsed() {
  const double limit = options_.merge_distance_px * options_.merge_distance_px;
  kept_.clear();
  for (auto younger = tracks_.begin(); younger != tracks_.end();) {
    if (younger->second.image != image_count_) {
      ++younger;
      continue;
    }
    const Eigen::Vector2d& pixel = younger->second.point.pixel;
    if (kept_.HasNear(pixel, limit)) {
      younger = tracks_.erase(younger);
    } else {
      kept_.Add(pixel);
      ++younger;
    }
  }
}

void Tracker::Impl::Publish() {
  points_.clear();
  for (const auto& [id, state] : tracks_) {
    if (state.image == image_count_) points_.push_back(state.point);
  }
}

std::vector<TrackId> Tracker::Impl::Detect() {
  if (current_.empty()) return {};
  std::vector<Eigen::Vector2d> taken;
  for (const TrackedPoint& point : points_) taken.push_back(point.pixel);
  const int room = max_points_ - static_cast<int>(points_.size());
  std::vector<TrackId> created;
  for (const Corner& corner : grid_.FindCorners(current_.image(), taken, room)) {
    const auto reference = ReferencePatch::Create(current_, corner.pixel);
    if (!reference) continue;
    const TrackId id(next_id_++);
    const double sigma = options_.base_sigma_px;
    tracks_.emplace(id, TrackState{.point = {id, corner.pixel, sigma, 0},
                                   .reference = *reference,
                                   .image = image_count_});
    created.push_back(id);
  }
  Publish();
  return created;
}

std::optional<TrackId> Tracker::Impl::StartAt(const Eigen::Vector2d& pixel) {
  if (current_.empty() || !IsUsable(pixel)) return std::nullopt;
  const auto reference = ReferencePatch::Create(current_, pixel);
  if (!reference) return std::nullopt;
  const TrackId id(next_id_++);
  tracks_.emplace(id, TrackState{.point = {id, pixel, options_.base_sigma_px, 0},
                                 .reference = *reference,
                                 .image = image_count_});
  Publish();
  return id;
}

void Tracker::Impl::Drop(std::span<const TrackId> tracks) {
  if (tracks.empty()) return;
  for (const TrackId& id : tracks) tracks_.erase(id);
  Publish();
}

std::vector<TrackId> Tracker::Impl::Reacquire(std::span<const SearchRegion> lost) {
  const PatchSearchOptions search{.min_correlation = options_.min_reacquire_correlation};
  std::vector<TrackId> revived;
  for (const SearchRegion& region : lost) {
    const auto it = lost_.find(region.track);
    if (it == lost_.end()) continue;
    TrackState& state = it->second;
    const auto found =
        SearchPatch(current_, state.reference, {region.pixel, region.warp * state.affine},
                    region.covariance_px2, search);
    if (!found || !IsUsable(found->pose.pixel)) continue;
    Accept(*found, &state);
    state.last_shift.setZero();
    tracks_.insert_or_assign(it->first, std::move(state));
    lost_.erase(it);
    revived.push_back(region.track);
  }
  if (revived.empty()) return revived;
  DropCollapsed();
  Publish();
  std::erase_if(revived, [this](const TrackId& id) { return !tracks_.contains(id); });
  std::sort(revived.begin(), revived.end());
  return revived;
}

std::vector<Feature> Tracker::Impl::Describe(bool complete) const {
  if (current_.empty()) return {};
  std::vector<Eigen::Vector2d> pixels;
  for (const TrackedPoint& point : points_) pixels.push_back(point.pixel);
  FeatureExtractorOptions options = options_.features;
  if (!complete) {
    options.max_extra_corners = 0;
    options.half_octaves = std::min(options.half_octaves, 1);
  }
  const auto described = ExtractFeatures(current_.image(), pixels, options);
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

const TrackedPoint* FindPoint(const std::vector<TrackedPoint>& points, TrackId track) {
  const auto it = std::lower_bound(
      points.begin(), points.end(), track,
      [](const TrackedPoint& point, TrackId wanted) { return point.track < wanted; });
  return it != points.end() && it->track == track ? &*it : nullptr;
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
  PORTOLAN_RETURN_IF_ERROR(TrackPredicted(gray, predictions, previous_from_current));
  TrackOthers({}, previous_from_current);
  return absl::OkStatus();
}

Status Tracker::TrackPredicted(const cv::Mat& gray, std::span<const TrackPrediction> predictions,
                               const Eigen::Quaterniond& previous_from_current) {
  const CameraModel& camera = impl_->camera();
  if (gray.type() != CV_8UC1 || gray.cols != camera.width_px() || gray.rows != camera.height_px()) {
    return absl::InvalidArgumentError(
        absl::StrCat("image is ", gray.cols, " x ", gray.rows, " of type ", gray.type(),
                     ", expected 8-bit grey, ", camera.width_px(), " x ", camera.height_px()));
  }
  impl_->TrackPredicted(gray, predictions, previous_from_current);
  return absl::OkStatus();
}

std::vector<TrackId> Tracker::Detect() { return impl_->Detect(); }

std::optional<TrackId> Tracker::StartAt(const Eigen::Vector2d& pixel) {
  return impl_->StartAt(pixel);
}

void Tracker::TrackOthers(std::span<const TrackPrediction> predictions,
                          const Eigen::Quaterniond& previous_from_current) {
  impl_->TrackOthers(predictions, previous_from_current);
}

void Tracker::Drop(std::span<const TrackId> tracks) { impl_->Drop(tracks); }
std::vector<TrackId> Tracker::Reacquire(std::span<const SearchRegion> lost) {
  return impl_->Reacquire(lost);
}
std::vector<TrackId> Tracker::lost() const { return impl_->lost(); }

int Tracker::max_points() const { return impl_->max_points(); }

const std::vector<TrackedPoint>& Tracker::points() const { return impl_->points(); }
std::vector<Feature> Tracker::Describe(bool complete) const { return impl_->Describe(complete); }

}  // namespace portolan
