// The agent's whole path from image to submap, without threads, files or network.
#ifndef PORTOLAN_AGENT_AGENT_H_
#define PORTOLAN_AGENT_AGENT_H_

#include <deque>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <span>
#include <vector>

#include "agent/filter/constant_velocity_model.h"
#include "agent/filter/local_filter.h"
#include "agent/imu/imu_buffer.h"
#include "agent/imu/imu_motion_model.h"
#include "agent/imu/inertial_initializer.h"
#include "agent/landmarks/landmark_initializer.h"
#include "agent/landmarks/landmark_manager.h"
#include "agent/landmarks/track_places.h"
#include "agent/local_adjustment/local_adjustment.h"
#include "agent/odometry/odometry_buffer.h"
#include "agent/odometry/odometry_motion_model.h"
#include "agent/range/range_scale.h"
#include "agent/revisit/revisit_options.h"
#include "agent/stereo/stereo_matcher.h"
#include "agent/submap/keyframe_selector.h"
#include "agent/submap/submap_builder.h"
#include "agent/submap/tracking_health.h"
#include "agent/tracker/tracker.h"
#include "common/base/status.h"
#include "common/camera/camera_model.h"

namespace portolan {

struct ImuOptions {
  ImuBufferOptions buffer;
  ImuModelOptions model;
  InertialInitializerOptions initializer;

  Status Validate() const;
};

struct OdometryOptions {
  OdometryBufferOptions buffer;
  OdometryModelOptions model;

  Status Validate() const;
};

// The IMU of a vehicle.
struct ImuMount {
  ImuCalibration calibration;
  Rigid3 imu_from_camera;
};

// What a vehicle has besides its camera: nothing, or any of wheel odometry and a second camera, or
// an IMU alone; a laser range finder with any of them.
struct VehicleSensors {
  std::optional<ImuMount> imu;
  // Of the wheel odometry: where the camera sits in the frame that it gives the pose of.
  std::optional<Rigid3> body_from_camera;
  std::optional<StereoMount> second_camera;
  // Of the satellite receiver, whose positions travel with the submaps and change nothing else.
  Eigen::Vector3d antenna_in_camera_m = Eigen::Vector3d::Zero();
  std::optional<RangeFinder> range_finder = std::nullopt;
};

struct AgentOptions {
  TrackerOptions tracker;
  FilterOptions filter;
  // Wider at the start than the filter's own default: real runs start in motion more often.
  ConstantVelocityOptions motion{.initial_linear_velocity_sigma = 0.7,
                                 .initial_angular_velocity_sigma = 0.7};
  LandmarkManagerOptions landmarks;
  LandmarkInitializerOptions initialization;
  TrackPlacesOptions track_places;
  // With fewer landmarks measured the camera's pose is not good enough to look for tracks by it.
  int min_landmarks_for_places = 15;
  KeyframeSelectorOptions keyframes;
  SubmapBuilderOptions submap;
  TrackingHealthOptions health;
  ImuOptions imu;
  OdometryOptions odometry;
  StereoOptions stereo;
  RangeOptions range;
  // Of the live poses, which AgentRunner tells; the agent itself does not adjust.
  LocalAdjustmentOptions local_adjustment;
  // Likewise; the agent describes the keyframes.
  RevisitOptions revisit;
  // New corners are looked for when fewer than this share of Tracker::max_points() is left, and at
  // every keyframe.
  double min_tracks_share = 0.8;

  Status Validate() const;
};

// What became of one image.
struct FrameResult {
  uint32_t submap_sequence_number = 0;
  // Link of that submap to its predecessor, and the predecessor's frame in case of kConnected.
  LinkType link = LinkType::kNone;
  Rigid3 predecessor_from_submap;
  Rigid3 submap_from_camera;
  // False while tracking is failing: the pose is a prediction.
  bool tracked = false;
  // The first frame of its submap. A submap that failed too early for an upload leaves its number
  // to the next one; this tells them apart.
  bool begins_submap = false;
  // The scale became known with this image: from here on the submap's units are metres, which its
  // earlier poses were not given in. Counts as a beginning (begins_submap) without predecessor.
  bool found_scale = false;
  // The submap's frames anew, those before this one too: the start became known only now. Empty in
  // all but one or a few frames of a start.
  std::vector<FramePose> restated;
  // Lengths are metres.
  bool metric = false;
  // Tracking failed for good, or the pause before this image was too long.
  bool tracking_failed = false;
  int landmarks_measured = 0;
  int tracks = 0;
  bool is_keyframe = false;
  // What the frame saw of the tracks, outliers of the filter left out; ascending track id. Empty
  // if the frame is not tracked.
  std::vector<LiveSight> sights;
  // The tracks described, of keyframes that are to be searched for landmarks of the map.
  std::vector<Feature> features;
  // The submap that this frame completed, ready for upload.
  std::optional<Submap> closed_submap;
};

// Protocol: ProcessImage for every frame in order of time, then Finish. Repeatable: the same
// images give the same submaps. Thread-compatible.
class Agent {
 public:
  static StatusOr<std::unique_ptr<Agent>> Create(const AgentOptions& options,
                                                 const CameraModel& camera, AgentId agent,
                                                 SessionId session,
                                                 const VehicleSensors& sensors = {});

  // Samples on the camera's clock, in order of time; those up to an image's time come before the
  // image. Only for an agent with an IMU. With them the submaps become metric as soon as the motion
  // has told the scale.
  void AddImu(std::span<const ImuSample> samples);
  const ImuCounts& imu_counts() const { return imu_samples_.counts(); }
  // Likewise, for an agent with wheel odometry; its submaps are metric from the start.
  void AddOdometry(std::span<const OdometrySample> samples);
  const OdometryCounts& odometry_counts() const { return odometry_samples_.counts(); }

  // Likewise, for an agent with a range finder; its submaps become metric as soon as a few ranges
  // agree on the scale.
  void AddRanges(std::span<const RangeSample> samples);
  RangeSampleCounts range_sample_counts() const;
  RangeCounts range_counts() const;

  // Satellite positions on the camera's clock, likewise.
  void AddGnss(std::span<const GnssFix> fixes);

  // gray: CV_8UC1 of the camera's size. InvalidArgument if it is not, or if time does not
  // increase; the frame is then ignored and the agent goes on. second: likewise of the second
  // camera, taken at the same instant; empty without one. With one the submaps are metric.
  StatusOr<FrameResult> ProcessImage(Timestamp time, const cv::Mat& gray,
                                     const cv::Mat& second = cv::Mat());

  // Takes the last frame as a keyframe and ends the open submap, if it is worth an upload.
  std::optional<Submap> Finish();

 private:
  Agent(const AgentOptions& options, const CameraModel& camera, const SubmapKey& key,
        std::unique_ptr<Tracker> tracker, std::unique_ptr<LocalFilter> filter,
        const VehicleSensors& sensors);

  Status CheckFrame(Timestamp time, const cv::Mat& gray, const cv::Mat& second) const;
  std::unique_ptr<MotionModel> MakeMotionModel() const;
  void StartTracking(Timestamp time, const cv::Mat& gray);
  // False if the second camera tells the depth of too few points to start.
  bool LearnDepthOfScene();
  // Predicts, and looks for the filter's landmarks; updates the filter with them; looks for the
  // other tracks.
  void TrackLandmarks(Timestamp time, const cv::Mat& gray);
  void UpdateFilter();
  void TrackOthers();
  // The camera's pose is good enough to look for tracks by it.
  bool KnowsPlaces() const;
  // Looks for lost tracks and ends those that have slipped before.
  void AddTrackedKeyframe(Timestamp time);
  // Without a scale yet: tries to learn it from the IMU and goes on with it. Ranges are used
  // always.
  void SeekScale(Timestamp time);
  // Follows the laser's spots; finds the scale by them, and holds it.
  void UseRanges();
  // Before a submap ends: all of it takes the scale that its ranges have told.
  void CorrectScale();
  // The filter's unit has become the metre, of which an old one held `scale`.
  void TakeUnit(double scale);
  // Poses of the start that the filter has found anew go into the submap.
  void RestateStart();
  void Remove(const LandmarkRemovals& removals);
  void Replenish(bool starting);
  void AddLandmarks(const std::vector<TrackId>& chosen, const std::vector<MeasuredDepth>& depths);
  void AddKeyframe(Timestamp time);
  void OpenSubmap(LinkType link);
  std::optional<Submap> CloseIfFull(Timestamp time);
  std::optional<Submap> HandleFailure(Timestamp spoiled_from);
  std::optional<Submap> TakeSubmap(Submap submap, size_t min_keyframes);
  // The fixes between its first and its last keyframe; earlier ones are forgotten.
  void TakeFixes(Submap* submap);
  // The live points without those that the filter just called outliers.
  std::vector<TrackedPoint> UsablePoints() const;
  FrameResult Report(bool tracked, std::optional<Submap> closed_submap);

  AgentOptions options_;
  CameraModel camera_;
  // Of the open submap.
  SubmapKey key_;
  LinkType link_ = LinkType::kNone;
  // Whether predecessor_from_submap_ is in the open submap's units.
  bool link_keeps_units_ = true;
  Rigid3 predecessor_from_submap_;
  const VehicleSensors sensors_;
  // The filter's motion model reads these.
  ImuBuffer imu_samples_;
  OdometryBuffer odometry_samples_;
  std::deque<GnssFix> fixes_;
  std::optional<InertialInitializer> initializer_;
  std::optional<StereoMatcher> stereo_;
  std::optional<RangeScale> ranges_;
  std::unique_ptr<Tracker> tracker_;
  std::unique_ptr<LocalFilter> filter_;
  LandmarkManager landmarks_;
  LandmarkInitializer depths_;
  TrackPlaces track_places_;
  KeyframeSelector keyframe_selector_;
  SubmapBuilder builder_;
  TrackingHealth health_;
  std::vector<PredictedMeasurement> predicted_;
  int measured_ = 0;
  // The camera's turn since the frame before, as it is known by now.
  Eigen::Quaterniond before_from_now_ = Eigen::Quaterniond::Identity();
  bool tracking_ = false;
  // The present frame has a second image.
  bool has_second_image_ = false;
  // The IMU has taken over since tracking began.
  bool inertial_ = false;
  // Of the present frame.
  bool is_keyframe_ = false;
  bool begins_submap_ = false;
  bool found_scale_ = false;
  std::vector<FramePose> restated_;
  bool tracking_failed_ = false;
  std::optional<Timestamp> last_time_;
  int64_t keyframe_count_ = 0;  // frames that were keyframes
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_AGENT_H_
