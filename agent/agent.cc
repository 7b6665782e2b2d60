#include "agent/agent.h"

#include <algorithm>
#include <string>
#include <utility>

#include "agent/agent_measurements.h"
#include "agent/imu/gyro_motion_model.h"
#include "common/base/check.h"

namespace portolan {
namespace {

// As proto/submap.proto has it.
constexpr size_t kMaxFixesOfSubmap = 1024;

std::vector<TrackedPoint> Filtered(std::vector<TrackedPoint> points, const auto& is_wanted) {
  std::erase_if(points, [&](const TrackedPoint& point) { return !is_wanted(point.track); });
  return points;
}

bool Contains(const std::vector<TrackId>& sorted, TrackId track) {
  return std::binary_search(sorted.begin(), sorted.end(), track);
}

}  // namespace

Status ImuOptions::Validate() const {
  PORTOLAN_RETURN_IF_ERROR(buffer.Validate());
  PORTOLAN_RETURN_IF_ERROR(model.Validate());
  return initializer.Validate();
}

Status OdometryOptions::Validate() const {
  PORTOLAN_RETURN_IF_ERROR(buffer.Validate());
  return model.Validate();
}

Status AgentOptions::Validate() const {
  PORTOLAN_RETURN_IF_ERROR(tracker.Validate());
  PORTOLAN_RETURN_IF_ERROR(filter.Validate());
  PORTOLAN_RETURN_IF_ERROR(motion.Validate());
  PORTOLAN_RETURN_IF_ERROR(landmarks.Validate());
  PORTOLAN_RETURN_IF_ERROR(initialization.Validate());
  PORTOLAN_RETURN_IF_ERROR(track_places.Validate());
  PORTOLAN_RETURN_IF_ERROR(keyframes.Validate());
  PORTOLAN_RETURN_IF_ERROR(submap.Validate());
  PORTOLAN_RETURN_IF_ERROR(health.Validate());
  PORTOLAN_RETURN_IF_ERROR(imu.Validate());
  PORTOLAN_RETURN_IF_ERROR(odometry.Validate());
  PORTOLAN_RETURN_IF_ERROR(stereo.Validate());
  PORTOLAN_RETURN_IF_ERROR(range.Validate());
  PORTOLAN_RETURN_IF_ERROR(local_adjustment.Validate());
  PORTOLAN_RETURN_IF_ERROR(revisit.Validate());
  if (!(min_tracks_share > 0 && min_tracks_share <= 1)) {
    return absl::InvalidArgumentError("min_tracks_share must be within 0 and 1");
  }
  if (min_landmarks_for_places < 0) {
    return absl::InvalidArgumentError("min_landmarks_for_places must not be negative");
  }
  return absl::OkStatus();
}

StatusOr<std::unique_ptr<Agent>> Agent::Create(const AgentOptions& options,
                                               const CameraModel& camera, AgentId agent,
                                               SessionId session, const VehicleSensors& sensors) {
  PORTOLAN_RETURN_IF_ERROR(options.Validate());
  if (sensors.imu && sensors.body_from_camera) {
    return absl::InvalidArgumentError("an agent takes an IMU or wheel odometry, not both");
  }
  if (sensors.imu && sensors.second_camera) {
    return absl::InvalidArgumentError("an agent takes an IMU or a second camera, not both");
  }
  PORTOLAN_ASSIGN_OR_RETURN(auto tracker, Tracker::Create(options.tracker, camera));
  PORTOLAN_ASSIGN_OR_RETURN(
      auto filter, LocalFilter::Create(options.filter, camera,
                                       std::make_unique<ConstantVelocityModel>(options.motion)));
  std::unique_ptr<Agent> result(new Agent(options, camera, SubmapKey{std::move(agent), session, 0},
                                          std::move(tracker), std::move(filter), sensors));
  if (sensors.range_finder) {
    PORTOLAN_ASSIGN_OR_RETURN(auto ranges,
                              RangeScale::Create(options.range, *sensors.range_finder, camera));
    result->ranges_.emplace(std::move(ranges));
  }
  return result;
}

Agent::Agent(const AgentOptions& options, const CameraModel& camera, const SubmapKey& key,
             std::unique_ptr<Tracker> tracker, std::unique_ptr<LocalFilter> filter,
             const VehicleSensors& sensors)
    : options_(options),
      camera_(camera),
      key_(key),
      sensors_(sensors),
      imu_samples_(options.imu.buffer),
      odometry_samples_(options.odometry.buffer),
      tracker_(std::move(tracker)),
      filter_(std::move(filter)),
      landmarks_(options.landmarks, camera),
      depths_(options.initialization, camera),
      track_places_(options.track_places, camera),
      keyframe_selector_(options.keyframes, camera),
      builder_(options.submap),
      health_(options.health) {
  if (sensors_.second_camera) {
    stereo_.emplace(options_.stereo, camera_, *sensors_.second_camera);
  }
  if (!sensors_.imu) return;
  initializer_.emplace(options_.imu.initializer, options_.imu.model, sensors_.imu->calibration,
                       sensors_.imu->imu_from_camera, camera_, &imu_samples_);
}

void Agent::AddImu(std::span<const ImuSample> samples) { imu_samples_.Add(samples); }

void Agent::AddOdometry(std::span<const OdometrySample> samples) { odometry_samples_.Add(samples); }

void Agent::AddRanges(std::span<const RangeSample> samples) {
  if (ranges_) ranges_->AddSamples(samples);
}

RangeSampleCounts Agent::range_sample_counts() const {
  return ranges_ ? ranges_->sample_counts() : RangeSampleCounts();
}

RangeCounts Agent::range_counts() const { return ranges_ ? ranges_->counts() : RangeCounts(); }

void Agent::AddGnss(std::span<const GnssFix> fixes) {
  fixes_.insert(fixes_.end(), fixes.begin(), fixes.end());
}

// Of an IMU only the gyro counts at first; all of it takes over once it is aligned.
std::unique_ptr<MotionModel> Agent::MakeMotionModel() const {
  if (sensors_.body_from_camera) {
    return std::make_unique<OdometryMotionModel>(options_.odometry.model,
                                                 *sensors_.body_from_camera, &odometry_samples_);
  }
  if (sensors_.imu) {
    return std::make_unique<GyroMotionModel>(
        options_.motion, options_.imu.model, options_.imu.initializer.alignment.gyro_bias_sigma,
        sensors_.imu->calibration, sensors_.imu->imu_from_camera.rotation.conjugate(),
        &imu_samples_);
  }
  return std::make_unique<ConstantVelocityModel>(options_.motion);
}

StatusOr<FrameResult> Agent::ProcessImage(Timestamp time, const cv::Mat& gray,
                                          const cv::Mat& second) {
  PORTOLAN_RETURN_IF_ERROR(CheckFrame(time, gray, second));
  has_second_image_ = stereo_ && !second.empty();
  if (has_second_image_) stereo_->SetImages(gray, second);
  is_keyframe_ = begins_submap_ = found_scale_ = tracking_failed_ = false;
  restated_.clear();
  std::optional<Submap> failed;
  const Duration pause = last_time_ ? time - *last_time_ : Duration::zero();
  if (tracking_ && health_.IsPauseTooLong(pause)) failed = HandleFailure(time);
  last_time_ = time;
  if (!tracking_) {
    StartTracking(time, gray);
    return Report(tracking_, std::move(failed));
  }
  TrackLandmarks(time, gray);
  UpdateFilter();
  TrackOthers();
  if (const auto spoiled_from = health_.Report(time, pause, measured_, filter_->Diverged())) {
    return Report(false, HandleFailure(*spoiled_from));
  }
  SeekScale(time);
  builder_.AddFrame(time, filter_->submap_from_camera());
  RestateStart();
  const bool tracked = !health_.last_frame_bad();
  if (tracked && keyframe_selector_.IsDue(time, filter_->submap_from_camera(), UsablePoints())) {
    AddTrackedKeyframe(time);
  }
  // What starts while tracking is bad would soon vouch for itself.
  if (tracked) Replenish(false);
  return Report(tracked, CloseIfFull(time));
}

Status Agent::CheckFrame(Timestamp time, const cv::Mat& gray, const cv::Mat& second) const {
  if (gray.type() != CV_8UC1) {
    return absl::InvalidArgumentError("the image is not 8-bit grey");
  }
  if (gray.cols != camera_.width_px() || gray.rows != camera_.height_px()) {
    return absl::InvalidArgumentError("the image is " + std::to_string(gray.cols) + "x" +
                                      std::to_string(gray.rows) + " px, the calibration is for " +
                                      std::to_string(camera_.width_px()) + "x" +
                                      std::to_string(camera_.height_px()) + " px");
  }
  if (sensors_.second_camera && !second.empty()) {
    const CameraModel& camera = sensors_.second_camera->camera;
    if (second.type() != CV_8UC1 || second.cols != camera.width_px() ||
        second.rows != camera.height_px()) {
      return absl::InvalidArgumentError(
          "the second camera's image is not 8-bit grey of its calibration's size");
    }
  }
  if (last_time_ && time <= *last_time_) {
    return absl::InvalidArgumentError("time " + std::to_string(ToSeconds(time)) +
                                      " s is not after the last frame's, " +
                                      std::to_string(ToSeconds(*last_time_)) + " s");
  }
  return absl::OkStatus();
}

void Agent::StartTracking(Timestamp time, const cv::Mat& gray) {
  inertial_ = false;
  if (initializer_) initializer_->Reset();
  if (ranges_) ranges_->Reset();
  landmarks_.Reset();
  depths_.Reset();
  track_places_.Reset();
  health_.Reset();
  PORTOLAN_CHECK(tracker_->Track(gray, {}, Eigen::Quaterniond::Identity()).ok());
  tracker_->Detect();
  measured_ = 0;
  if (stereo_ && !LearnDepthOfScene()) return;
  filter_->Start(time, MakeMotionModel());
  Replenish(true);
  // An image without corners starts nothing; the next one is tried.
  tracking_ = landmarks_.count() >= options_.health.min_inliers;
  if (!tracking_) return;
  OpenSubmap(link_);
  builder_.AddFrame(time, Rigid3::Identity());
  AddKeyframe(time);
}

bool Agent::LearnDepthOfScene() {
  if (!has_second_image_) return false;
  std::vector<MeasuredDepth> depths =
      stereo_->Measure(MeasurementsOf(tracker_->points(), [](TrackId) { return true; }));
  if (static_cast<int>(depths.size()) < options_.health.min_inliers) return false;
  const auto middle = depths.begin() + static_cast<std::ptrdiff_t>(depths.size() / 2);
  std::nth_element(depths.begin(), middle, depths.end(),
                   [](const auto& a, const auto& b) { return a.inverse_depth < b.inverse_depth; });
  filter_->TakeMetricDepths(middle->inverse_depth);
  return true;
}

void Agent::Remove(const LandmarkRemovals& removals) {
  tracker_->Drop(removals.tracks);
  filter_->RemoveLandmarks(removals.landmarks);
  landmarks_.Remove(removals.landmarks);
}

void Agent::Replenish(bool starting) {
  const auto few = static_cast<size_t>(options_.min_tracks_share * tracker_->max_points());
  if (!starting && (is_keyframe_ || tracker_->points().size() < few)) tracker_->Detect();
  if (measured_ * 10 > options_.landmarks.target_landmarks * 9) return;
  const bool undelayed = starting || !depths_.IsDelayed(measured_);
  const auto is_candidate = [&](TrackId track) {
    return landmarks_.IsLandmark(track) || depths_.IsReady(track);
  };
  const auto choose = [&](const std::vector<TrackedPoint>& points) {
    return landmarks_.Choose(points, measured_, starting);
  };
  std::vector<TrackId> chosen =
      undelayed ? choose(tracker_->points()) : choose(Filtered(tracker_->points(), is_candidate));
  std::vector<MeasuredDepth> depths;
  if (!undelayed) depths = depths_.Measure(&chosen);
  Remove({landmarks_.MakeRoomFor(static_cast<int>(chosen.size())), {}});
  if (chosen.empty()) return;
  AddLandmarks(chosen, depths);
  landmarks_.Add(chosen);
}

void Agent::AddLandmarks(const std::vector<TrackId>& chosen,
                         const std::vector<MeasuredDepth>& depths) {
  std::vector<Measurement> points = MeasurementsOf(
      tracker_->points(), [&chosen](TrackId track) { return Contains(chosen, track); });
  if (!has_second_image_) {
    filter_->AddLandmarks(points, depths);
    return;
  }
  // Those that the second camera sees first: of the others their depths are all that is known.
  const std::vector<MeasuredDepth> seen_twice = stereo_->Measure(points);
  const auto rest = std::stable_partition(points.begin(), points.end(), [&](const Measurement& m) {
    return std::any_of(seen_twice.begin(), seen_twice.end(),
                       [&m](const MeasuredDepth& depth) { return depth.track == m.track; });
  });
  filter_->AddLandmarks({points.begin(), rest}, seen_twice);
  filter_->AddLandmarks({rest, points.end()}, depths);
}

std::vector<TrackedPoint> Agent::UsablePoints() const {
  std::vector<TrackedPoint> usable;
  usable.reserve(tracker_->points().size());
  for (const TrackedPoint& point : tracker_->points()) {
    if (!landmarks_.WasOutlier(point.track)) usable.push_back(point);
  }
  return usable;
}

void Agent::AddKeyframe(Timestamp time) {
  is_keyframe_ = true;
  const std::vector<TrackedPoint> points = UsablePoints();
  keyframe_selector_.SetKeyframe(time, filter_->submap_from_camera(), points);
  std::vector<Feature> features;
  if (builder_.NextIsDescribed()) features = tracker_->Describe();
  builder_.AddKeyframe(time, filter_->submap_from_camera(), filter_->pose_covariance(), points,
                       std::move(features));
}

void Agent::OpenSubmap(LinkType link) {
  link_ = link;
  link_keeps_units_ = true;
  begins_submap_ = true;
  builder_.Open(key_, link);
}

std::optional<Submap> Agent::TakeSubmap(Submap submap, size_t min_keyframes) {
  if (submap.keyframes.size() < min_keyframes) return std::nullopt;
  submap.metric = filter_->metric();
  submap.gravity_in_submap = filter_->motion().gravity_in_submap();
  TakeFixes(&submap);
  ++key_.sequence_number;
  return submap;
}

void Agent::TakeFixes(Submap* submap) {
  while (!fixes_.empty() && fixes_.front().time < submap->keyframes.front().time) {
    fixes_.pop_front();
  }
  std::vector<GnssFix> taken;
  while (!fixes_.empty() && fixes_.front().time < submap->keyframes.back().time) {
    taken.push_back(fixes_.front());
    fixes_.pop_front();
  }
  // A receiver faster than a submap's limit repeats itself.
  const size_t stride = taken.size() / kMaxFixesOfSubmap + 1;
  for (size_t i = 0; i < taken.size(); i += stride) submap->gnss.push_back(taken[i]);
  if (!submap->gnss.empty()) submap->antenna_in_camera_m = sensors_.antenna_in_camera_m;
}

std::optional<Submap> Agent::CloseIfFull(Timestamp time) {
  if (!is_keyframe_ || !builder_.IsFull(1.0 / filter_->median_inverse_depth())) return std::nullopt;
  CorrectScale();
  auto closed = TakeSubmap(builder_.Close(filter_->Landmarks()), 2);
  predecessor_from_submap_ = filter_->BeginSubmap();
  if (initializer_) initializer_->Rebase(predecessor_from_submap_);
  depths_.Rebase(predecessor_from_submap_);
  track_places_.Rebase(predecessor_from_submap_);
  if (ranges_) ranges_->Rebase(predecessor_from_submap_);
  OpenSubmap(LinkType::kConnected);
  builder_.AddFrame(time, Rigid3::Identity());
  AddKeyframe(time);
  return closed;
}

std::optional<Submap> Agent::HandleFailure(Timestamp spoiled_from) {
  auto closed = TakeSubmap(builder_.CloseBefore(spoiled_from),
                           static_cast<size_t>(options_.submap.min_keyframes));
  link_ = key_.sequence_number == 0 ? LinkType::kNone : LinkType::kBroken;
  predecessor_from_submap_ = Rigid3::Identity();
  tracking_ = false;
  tracking_failed_ = true;
  std::vector<TrackId> all;
  for (const TrackedPoint& point : tracker_->points()) all.push_back(point.track);
  tracker_->Drop(all);
  return closed;
}

std::optional<Submap> Agent::Finish() {
  if (!tracking_) return std::nullopt;
  tracking_ = false;
  if (!is_keyframe_ && !health_.last_frame_bad()) AddKeyframe(*last_time_);
  CorrectScale();
  return TakeSubmap(builder_.Close(filter_->Landmarks()), 2);
}

FrameResult Agent::Report(bool tracked, std::optional<Submap> closed_submap) {
  FrameResult result;
  result.submap_sequence_number = key_.sequence_number;
  result.link = link_ == LinkType::kConnected && !link_keeps_units_ ? LinkType::kBroken : link_;
  result.predecessor_from_submap = predecessor_from_submap_;
  result.submap_from_camera = filter_->submap_from_camera();
  result.tracked = tracked;
  result.begins_submap = begins_submap_ || found_scale_;
  result.found_scale = found_scale_;
  result.restated = restated_;
  result.metric = filter_->metric();
  result.tracking_failed = tracking_failed_;
  result.landmarks_measured = measured_;
  result.tracks = static_cast<int>(tracker_->points().size());
  result.is_keyframe = is_keyframe_;
  if (tracked) {
    const std::vector<TrackedPoint> usable = UsablePoints();
    result.sights.reserve(usable.size());
    for (const TrackedPoint& point : usable) {
      result.sights.push_back(
          {{point.track, point.pixel.cast<float>(), static_cast<float>(point.sigma_px)},
           landmarks_.IsLandmark(point.track)});
    }
  }
  if (tracked && is_keyframe_ && options_.revisit.enabled &&
      keyframe_count_++ % options_.revisit.keyframe_interval == 0) {
    result.features = tracker_->Describe(false);
  }
  result.closed_submap = std::move(closed_submap);
  return result;
}

}  // namespace portolan
