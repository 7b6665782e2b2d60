// The agent's local filter: an error-state EKF over the camera's motion and a few dozen landmarks
// in inverse depth, in the frame of the current submap.
#ifndef PORTOLAN_AGENT_FILTER_LOCAL_FILTER_H_
#define PORTOLAN_AGENT_FILTER_LOCAL_FILTER_H_

#include <deque>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "agent/filter/filter_options.h"
#include "agent/filter/filter_state.h"
#include "agent/filter/inlier_selector.h"
#include "agent/filter/kalman_update.h"
#include "agent/filter/measurement.h"
#include "agent/filter/start_smoother.h"

namespace portolan {

// Civera, Davison, Montiel, "Inverse Depth Parametrization for Monocular SLAM", T-RO 2008, and
// Civera et al., "1-Point RANSAC for EKF Filtering", JFR 2010; the derivation is in README.md.
//
// Protocol, a frame: Predict(time), PredictMeasurements() to search the image, Update(matches),
// then RemoveLandmarks and AddLandmarks as the owner sees fit. Start() opens a submap that hangs on
// nothing, BeginSubmap() one that continues. Thread-compatible; deterministic: equal calls give
// equal states.
class LocalFilter {
 public:
  // InvalidArgument if an option is out of range. Without a motion model the camera is taken to
  // move at constant velocity, with the default noise.
  static StatusOr<std::unique_ptr<LocalFilter>> Create(const FilterOptions& options,
                                                       const CameraModel& camera,
                                                       std::unique_ptr<MotionModel> motion);

  // A new unconnected submap: no landmarks, pose identity and exactly known.
  void Start(Timestamp time);
  // The same with another motion model.
  void Start(Timestamp time, std::unique_ptr<MotionModel> motion);
  // The last update ended the start, or a part of it, and has its poses anew.
  bool restated() const { return !restated_poses_.empty(); }
  // Those, from the start's first frame to this one, not all in between (StartSmoother). Empty
  // otherwise; taken once.
  std::vector<std::pair<Timestamp, Rigid3>> TakeRestatedPoses() {
    return std::exchange(restated_poses_, {});
  }
  // From now on measured depths are metric, of a sensor, and so is the filter, whatever the motion
  // model. A start then takes the scene to be this far, 1/m.
  void TakeMetricDepths(double first_inverse_depth);
  // A length that a sensor has measured between two frames, as a function of the state: its
  // derivative by the error of the whole state, and what it is more than expected.
  struct LengthMeasurement {
    Eigen::RowVectorXd d_state;
    double innovation = 0;
    double variance = 0;
  };
  // False, and nothing done, if the innovation is outside of the chi-square(1) region.
  bool UpdateWithLength(const LengthMeasurement& measurement, double gate_chi2);
  // Makes metres of the unit of length, of which one holds `scale` metres. It stays an exact unit:
  // how well its metres are known is the caller's to know. False, and nothing done, where a sensor
  // tells the scale or too few depths are known. A start forgets it.
  bool TakeScale(double scale);
  // Whether what TakeScale found still counts as metres; it does at first.
  void TrustScale(bool trusted) { scale_is_trusted_ = trusted; }
  bool has_scale() const { return has_scale_; }
  // Derivative of the mean logarithm of the known inverse depths by the state's error, what
  // lengths may be compared with while there is no scale. No value if too few are known.
  std::optional<Eigen::RowVectorXd> DScaleDState() const;
  // The first frames are still being gathered (StartSmoother): what the filter says of depths will
  // be taken back.
  bool starting() const { return start_.active(); }
  // Goes on with another motion model, between two frames.
  void ChangeMotion(std::unique_ptr<MotionModel> motion, const MotionChange& change);
  // Propagates to the time of a frame. Does nothing, and returns false, if time does not advance.
  bool Predict(Timestamp time);
  // All landmarks that project into the image, in the order of the state.
  std::vector<PredictedMeasurement> PredictMeasurements() const;
  // Measurements of unknown tracks, or that are not finite, count as outliers.
  UpdateResult Update(std::span<const Measurement> measurements);
  // New landmarks at the current pose, at most until the state is full. Tracks that are in the
  // state already are passed over. Those among `depths` start with that depth, the others with the
  // prior. Returns how many were added.
  int AddLandmarks(std::span<const Measurement> measurements,
                   std::span<const MeasuredDepth> depths = {});
  void RemoveLandmarks(std::span<const TrackId> tracks);
  // The current camera becomes the frame of a new submap; motion and all landmarks are carried
  // over with their joint covariance (conditionally independent submaps, Pinies & Tardos, T-RO
  // 2008). Returns old_submap_from_new_submap.
  Rigid3 BeginSubmap();

  Rigid3 submap_from_camera() const { return state_.motion().submap_from_camera(); }
  // Of the right perturbation [translation; rotation] of submap_from_camera (Rigid3's).
  Matrix6d pose_covariance() const;
  // In the submap frame, submap units per second.
  Eigen::Vector3d linear_velocity() const { return state_.motion().linear_velocity(); }
  Eigen::Vector3d angular_velocity_rad_s() const {
    return state_.motion().angular_velocity_rad_s();
  }
  std::vector<LandmarkEstimate> Landmarks() const;
  int landmark_count() const { return static_cast<int>(state_.landmarks().size()); }
  bool HasLandmark(TrackId track) const { return state_.Find(track) >= 0; }
  // Median over the landmarks in view of 1 / distance to the current camera, the scale of the
  // scene. If none is in view, or most are at infinity, the last good value.
  double median_inverse_depth() const { return median_inverse_depth_; }
  // Lengths are metres.
  bool metric() const {
    return metric_depths_ || state_.motion().metric() || (has_scale_ && scale_is_trusted_);
  }
  Timestamp time() const { return state_.motion().time(); }

  // True if the last divergence_window_frames updates show that the estimate is not to be trusted
  // (FilterOptions states the limits). The owner closes the submap and calls Start.
  bool Diverged() const;
  // Mean normalised innovation and share of inliers over that window.
  double WindowNormalisedInnovation() const;
  double WindowInlierRatio() const;

  const FilterState& state() const { return state_; }
  MotionModel& motion() { return state_.motion(); }
  const MotionModel& motion() const { return state_.motion(); }
  const CameraModel& camera() const { return camera_; }

 private:
  struct FrameStatistics {
    double normalised_innovation = 0;
    int inliers = 0;
    int matches = 0;
  };

  LocalFilter(const FilterOptions& options, const CameraModel& camera,
              std::unique_ptr<MotionModel> motion);

  // Compressed update: makes the points out of view passive, as long as none comes into view.
  void ChoosePassive();
  // Sorts the measurements into matches_ (known, projecting) and outliers.
  void FindMatches(std::span<const Measurement> measurements, UpdateResult* result);
  // Moves the matches inside the prior gate to the front; returns their number.
  int GateMatches();
  // The candidates are far from linear: their unknown depths matter as soon as the camera moves.
  bool IsFarFromLinear(int gated);
  // Updates with the inliers of the most likely motion, whatever the linearisation says.
  double UpdateByExploring(int gated);
  // Updates with the low-innovation inliers among the gated; returns v' S^-1 v.
  double UpdateLowInnovation(int gated, UpdateResult* result);
  // Updates with those of the rest that fit now.
  double UpdateRescued();
  // Updates with the used candidates from `first` on; unmarks those that do not fit after all.
  double UpdateWithUsed(int first, const Eigen::VectorXd* start = nullptr);
  // Drops impossible depths and converts the rays whose depth has become linear.
  void MaintainLandmarks(UpdateResult* result);
  // Keeps the frame for the smoothed start, and ends it when it is due.
  void RecordStart(UpdateResult* result);
  bool SolveStart(UpdateResult* result);
  bool DepthsAreKnown() const;
  // Where new landmarks start; see FilterOptions.
  struct DepthPrior {
    double inverse_depth = 0;
    double sigma = 0;
    Eigen::RowVectorXd d_depth_d_state;
  };
  DepthPrior PriorOfNewLandmarks();
  static DepthPrior WithMeasured(const DepthPrior& prior, const MeasuredDepth& depth);
  // Makes the mean of the known depths the exact unit of length, unless there is a metric one. Not
  // at the start, where the scale must give way to what the first, nonlinear frames got wrong.
  void FixScale();
  void UpdateMedianInverseDepth();
  double PixelVariance(const Measurement& measurement) const;
  void RecordStatistics(const UpdateResult& result);

  struct Candidate {
    TrackId track;
    Match match;
    LinearMeasurement linear;
    bool used = false;
  };

  const FilterOptions options_;
  const CameraModel camera_;
  FilterState state_;
  KalmanUpdate kalman_;
  StartSmoother start_;
  std::unique_ptr<InlierSelector> selector_;
  std::vector<Candidate> candidates_;
  std::vector<Match> matches_;
  std::vector<LinearMeasurement> linear_;
  std::vector<double> inverse_depths_;
  std::vector<double> spreads_;
  std::vector<bool> out_of_view_;
  std::deque<FrameStatistics> window_;
  double first_inverse_depth_;
  double median_inverse_depth_;
  double scene_depth_of_prediction_ = 1;
  int retry_frames_ = 0;
  std::vector<std::pair<Timestamp, Rigid3>> restated_poses_;
  bool metric_depths_ = false;
  bool has_scale_ = false;
  bool scale_is_trusted_ = false;
  bool noise_is_fresh_ = false;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_FILTER_LOCAL_FILTER_H_
