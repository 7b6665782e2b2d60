#include "agent/filter/local_filter.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <utility>

#include "agent/filter/constant_velocity_model.h"
#include "agent/filter/known_depths.h"
#include "common/base/check.h"

namespace portolan {
namespace {

double NormalisedSquare(const Eigen::Vector2d& v, const Eigen::Matrix2d& covariance) {
  return v.dot(covariance.inverse() * v);
}

// Innovation squared of one measurement in its own ellipse.
double Innovation(const FilterState& state, const LinearMeasurement& linear) {
  Eigen::Matrix2d s = PredictedCovariance(state, linear);
  s.diagonal().array() += linear.variance;
  return NormalisedSquare(linear.innovation, s);
}

}  // namespace

StatusOr<std::unique_ptr<LocalFilter>> LocalFilter::Create(const FilterOptions& options,
                                                           const CameraModel& camera,
                                                           std::unique_ptr<MotionModel> motion) {
  PORTOLAN_RETURN_IF_ERROR(options.Validate());
  if (motion == nullptr) {
    motion = std::make_unique<ConstantVelocityModel>(ConstantVelocityOptions{});
  }
  return std::unique_ptr<LocalFilter>(new LocalFilter(options, camera, std::move(motion)));
}

LocalFilter::LocalFilter(const FilterOptions& options, const CameraModel& camera,
                         std::unique_ptr<MotionModel> motion)
    : options_(options),
      camera_(camera),
      state_(std::move(motion), options.max_landmarks),
      kalman_(options.kalman, state_.max_dim(), options.max_landmarks),
      start_(options.start),
      selector_(MakeInlierSelector(options)),
      first_inverse_depth_(options.first_inverse_depth),
      median_inverse_depth_(options.first_inverse_depth) {
  candidates_.reserve(options.max_landmarks);
  matches_.reserve(options.max_landmarks);
  linear_.reserve(options.max_landmarks);
  inverse_depths_.reserve(options.max_landmarks);
  Start(Timestamp{});
}

void LocalFilter::Start(Timestamp time) {
  median_inverse_depth_ = first_inverse_depth_;
  state_.Start(time, 1.0 / median_inverse_depth_);
  window_.clear();
  noise_is_fresh_ = has_scale_ = false;
  retry_frames_ = 0;
  restated_poses_.clear();
  start_.Begin(state_.motion(), state_.covariance());
}

void LocalFilter::Start(Timestamp time, std::unique_ptr<MotionModel> motion) {
  state_.ResetMotion(std::move(motion));
  Start(time);
}

void LocalFilter::TakeMetricDepths(double first_inverse_depth) {
  metric_depths_ = true;
  first_inverse_depth_ = first_inverse_depth;
}

void LocalFilter::ChangeMotion(std::unique_ptr<MotionModel> motion, const MotionChange& change) {
  start_.End();
  state_.ChangeMotion(std::move(motion), change);
  median_inverse_depth_ /= change.scale;
  noise_is_fresh_ = false;
  PORTOLAN_DCHECK(state_.IsCovarianceValid());
}

bool LocalFilter::Predict(Timestamp time) {
  scene_depth_of_prediction_ = 1.0 / median_inverse_depth_;
  noise_is_fresh_ = state_.Predict(time, scene_depth_of_prediction_);
  ChoosePassive();
  return noise_is_fresh_;
}

std::vector<PredictedMeasurement> LocalFilter::PredictMeasurements() const {
  std::vector<PredictedMeasurement> result;
  result.reserve(state_.landmarks().size());
  for (int i = 0; i < landmark_count(); ++i) {
    const auto linear = Linearise(state_, camera_, {i, Eigen::Vector2d::Zero(), 1.0});
    if (!linear.has_value() || !camera_.IsInImage(-linear->innovation)) continue;
    result.push_back({state_.landmarks()[i].track, -linear->innovation,
                      PredictedCovariance(state_, *linear) + Eigen::Matrix2d::Identity()});
  }
  return result;
}

UpdateResult LocalFilter::Update(std::span<const Measurement> measurements) {
  UpdateResult result;
  FindMatches(measurements, &result);
  int gated = GateMatches();
  if (noise_is_fresh_ && gated < options_.manoeuvre_gate_share * candidates_.size()) {
    state_.InflateLastNoise(options_.manoeuvre_noise_factor);
    result.manoeuvre = true;
    gated = GateMatches();
  }
  noise_is_fresh_ = false;
  double sum =
      IsFarFromLinear(gated) ? UpdateByExploring(gated) : UpdateLowInnovation(gated, &result);
  sum += UpdateRescued();
  for (const Candidate& candidate : candidates_) {
    (candidate.used ? result.inliers : result.outliers).push_back(candidate.track);
  }
  if (!result.inliers.empty()) result.normalised_innovation = sum / (2.0 * result.inliers.size());
  RecordStart(&result);
  MaintainLandmarks(&result);
  UpdateMedianInverseDepth();
  ChoosePassive();
  RecordStatistics(result);
  PORTOLAN_DCHECK(state_.IsCovarianceValid());
  return result;
}

void LocalFilter::ChoosePassive() {
  if (options_.covariance_update == CovarianceUpdate::kFull) return;
  const Rigid3 camera_pose = submap_from_camera();
  out_of_view_.assign(state_.landmarks().size(), false);
  int idle = 0;
  for (int i = 0; i < landmark_count(); ++i) {
    const Landmark& landmark = state_.landmarks()[i];
    if (!landmark.euclidean) continue;
    const auto pixel =
        ProjectLandmark(landmark, state_.AnchorPosition(landmark), camera_pose, camera_);
    out_of_view_[i] = !pixel.has_value() || !camera_.IsInImage(*pixel);
    if (!out_of_view_[i]) {
      state_.Activate(i);
    } else if (!state_.IsPassive(landmark)) {
      ++idle;
    }
  }
  // Bringing the passive ones up to date, to take in others, has to be worth it.
  const int active = landmark_count() - state_.passive_count();
  if (4 * idle > (state_.passive_count() == 0 ? 0 : active)) state_.SetPassive(out_of_view_);
}

void LocalFilter::FindMatches(std::span<const Measurement> measurements, UpdateResult* result) {
  candidates_.clear();
  for (const Measurement& measurement : measurements) {
    const int index = state_.Find(measurement.track);
    const bool duplicate =
        std::any_of(candidates_.begin(), candidates_.end(),
                    [&](const Candidate& c) { return c.track == measurement.track; });
    const bool valid = index >= 0 && !duplicate && measurement.pixel.allFinite() &&
                       std::isfinite(measurement.sigma_px) && measurement.sigma_px > 0;
    if (!valid) {
      if (!duplicate) result->outliers.push_back(measurement.track);
      continue;
    }
    // A track may live on where its landmark is not expected.
    state_.Activate(index);
    Candidate candidate;
    candidate.track = measurement.track;
    candidate.match = {index, measurement.pixel, PixelVariance(measurement)};
    candidates_.push_back(candidate);
  }
}

int LocalFilter::GateMatches() {
  const auto inside = [&](Candidate& candidate) {
    const auto linear = Linearise(state_, camera_, candidate.match);
    if (!linear.has_value()) return false;
    candidate.linear = *linear;
    return Innovation(state_, *linear) < options_.prior_gate_chi2;
  };
  return std::stable_partition(candidates_.begin(), candidates_.end(), inside) -
         candidates_.begin();
}

bool LocalFilter::IsFarFromLinear(int gated) {
  if (gated == 0) return false;
  spreads_.clear();
  for (int i = 0; i < gated; ++i) {
    const LinearMeasurement& linear = candidates_[i].linear;
    spreads_.push_back(
        DepthShiftCovariance(state_, linear, ShiftCovariance(state_, linear)).trace() /
        (2 * linear.variance));
  }
  std::nth_element(spreads_.begin(), spreads_.begin() + gated / 2, spreads_.end());
  return spreads_[gated / 2] > options_.explore_variance;
}

double LocalFilter::UpdateByExploring(int gated) {
  matches_.clear();
  for (int i = 0; i < gated; ++i) matches_.push_back(candidates_[i].match);
  // From rest, and from half a sigma of position along each axis of the camera.
  std::vector<Eigen::Vector3d> shifts = {Eigen::Vector3d::Zero()};
  const Eigen::Matrix3d axes = submap_from_camera().rotation.toRotationMatrix();
  for (int i = 0; i < 3; ++i) {
    const Eigen::Vector3d axis = axes.col(i);
    const double sigma = std::sqrt(axis.dot(state_.covariance().topLeftCorner<3, 3>() * axis));
    shifts.push_back(0.5 * sigma * axis);
    shifts.push_back(-0.5 * sigma * axis);
  }
  const auto found = kalman_.Explore(matches_, shifts, camera_, &state_);
  if (!found.has_value()) return 0;
  for (int i : found->inliers) candidates_[i].used = true;
  return UpdateWithUsed(0, &found->correction);
}

double LocalFilter::UpdateLowInnovation(int gated, UpdateResult* result) {
  if (gated == 0) return 0;
  matches_.clear();
  linear_.clear();
  for (int i = 0; i < gated; ++i) {
    matches_.push_back(candidates_[i].match);
    linear_.push_back(candidates_[i].linear);
  }
  kalman_.ComputePHt(state_, linear_);
  const InlierSet inliers = selector_->Select(
      matches_, linear_, kalman_.pht(state_.active_dim(), gated), state_, camera_);
  result->ransac_hypotheses = inliers.hypotheses;
  for (int i : inliers.matches) candidates_[i].used = true;
  return UpdateWithUsed(0);
}

double LocalFilter::UpdateRescued() {
  // Those already used go to the front, so that the update takes the rest.
  const auto rest = std::stable_partition(candidates_.begin(), candidates_.end(),
                                          [](const Candidate& c) { return c.used; });
  for (auto candidate = rest; candidate != candidates_.end(); ++candidate) {
    const auto linear = Linearise(state_, camera_, candidate->match);
    candidate->used = linear && Innovation(state_, *linear) < options_.rescue_chi2;
  }
  return UpdateWithUsed(rest - candidates_.begin());
}

double LocalFilter::UpdateWithUsed(int first, const Eigen::VectorXd* start) {
  matches_.clear();
  for (size_t i = first; i < candidates_.size(); ++i) {
    if (!candidates_[i].used) continue;
    matches_.push_back(candidates_[i].match);
    matches_.back().candidate = static_cast<int>(i);
    candidates_[i].used = false;
  }
  const auto sum = kalman_.Apply(&matches_, camera_, &state_, start);
  if (!sum.has_value()) return 0;
  for (const Match& match : matches_) candidates_[match.candidate].used = true;
  return *sum;
}

void LocalFilter::MaintainLandmarks(UpdateResult* result) {
  const Eigen::Vector3d camera_position = submap_from_camera().translation;
  for (int i = landmark_count() - 1; i >= 0; --i) {
    const Landmark& landmark = state_.landmarks()[i];
    if (landmark.euclidean) continue;
    const int row = state_.Offset(landmark) + 2;
    const double variance = state_.covariance()(row, row);
    if (landmark.inverse_depth < -options_.negative_depth_sigmas * std::sqrt(variance)) {
      result->dropped.push_back(landmark.track);
      state_.RemoveLandmark(i);
    } else if (!start_.active() &&
               LinearityIndex(landmark, state_.AnchorPosition(landmark), variance,
                              camera_position) < options_.linearity_threshold) {
      state_.ConvertToEuclidean(i);
    }
  }
}

void LocalFilter::UpdateMedianInverseDepth() {
  const Rigid3 camera_pose = submap_from_camera();
  inverse_depths_.clear();
  for (const Landmark& landmark : state_.landmarks()) {
    const Eigen::Vector3d direction =
        DirectionInCamera(landmark, state_.AnchorPosition(landmark), camera_pose);
    const auto pixel = camera_.Project(direction);
    if (!pixel.has_value() || !camera_.IsInImage(*pixel)) continue;
    inverse_depths_.push_back((landmark.euclidean ? 1.0 : landmark.inverse_depth) /
                              direction.norm());
  }
  if (inverse_depths_.empty()) return;
  const auto middle = inverse_depths_.begin() + inverse_depths_.size() / 2;
  std::nth_element(inverse_depths_.begin(), middle, inverse_depths_.end());
  // Below a thousandth of the last value the scene is at infinity and tells no scale.
  if (*middle > 1e-3 * median_inverse_depth_) median_inverse_depth_ = *middle;
}

void LocalFilter::FixScale() {
  if (metric_depths_) return;
  const MeanDepth mean = MeanOfKnownDepths(state_, options_.known_depth_sigma_ratio);
  if (mean.count >= options_.min_known_depths) state_.FixScale(mean.d_log_d_state);
}

LocalFilter::DepthPrior LocalFilter::PriorOfNewLandmarks() {
  state_.Expand();
  const MeanDepth mean = MeanOfKnownDepths(state_, options_.known_depth_sigma_ratio);
  DepthPrior prior;
  if (mean.count < options_.min_known_depths) {
    prior.inverse_depth = median_inverse_depth_;
    prior.sigma = options_.inverse_depth_sigma_ratio * prior.inverse_depth;
    return prior;
  }
  prior.inverse_depth = std::exp(mean.log_inverse_depth);
  prior.sigma = options_.relative_inverse_depth_sigma_ratio * prior.inverse_depth;
  prior.d_depth_d_state = prior.inverse_depth * mean.d_log_d_state;
  return prior;
}

LocalFilter::DepthPrior LocalFilter::WithMeasured(const DepthPrior& prior,
                                                  const MeasuredDepth& depth) {
  // A depth that was triangulated from the state's own motion has the state's error of scale.
  DepthPrior result;
  if (!depth.is_metric) {
    result.d_depth_d_state = prior.d_depth_d_state * (depth.inverse_depth / prior.inverse_depth);
  }
  result.inverse_depth = depth.inverse_depth;
  result.sigma = depth.sigma;
  return result;
}

int LocalFilter::AddLandmarks(std::span<const Measurement> measurements,
                              std::span<const MeasuredDepth> depths) {
  if (measurements.empty()) return 0;
  const DepthPrior general_prior = PriorOfNewLandmarks();
  const Eigen::Quaterniond rotation = submap_from_camera().rotation;
  int anchor = -1, added = 0;
  for (const Measurement& measurement : measurements) {
    if (state_.full()) break;
    if (HasLandmark(measurement.track) || !measurement.pixel.allFinite()) continue;
    const auto depth = std::find_if(depths.begin(), depths.end(), [&](const MeasuredDepth& d) {
      return d.track == measurement.track;
    });
    const DepthPrior prior =
        depth == depths.end() ? general_prior : WithMeasured(general_prior, *depth);
    const auto ray =
        MakeRay(measurement.track, measurement.pixel, prior.inverse_depth, rotation, camera_);
    if (!ray.has_value()) continue;
    if (anchor < 0) anchor = state_.AddAnchor();
    state_.AddRay(*ray, anchor, PixelVariance(measurement), prior.sigma * prior.sigma,
                  prior.d_depth_d_state);
    // The smoother has the measurements that a depth from the filter's own state comes from, so for
    // it that depth is a first guess.
    const double sigma_of_guess =
        prior.d_depth_d_state.size() == 0
            ? prior.sigma
            : std::max(prior.sigma, options_.inverse_depth_sigma_ratio * prior.inverse_depth);
    start_.AddPoint({measurement.track, measurement.pixel, PixelVariance(measurement)},
                    prior.inverse_depth, sigma_of_guess);
    ++added;
  }
  return added;
}

double LocalFilter::PixelVariance(const Measurement& measurement) const {
  return measurement.sigma_px * measurement.sigma_px +
         options_.model_sigma_px * options_.model_sigma_px;
}

void LocalFilter::RemoveLandmarks(std::span<const TrackId> tracks) {
  for (TrackId track : tracks) {
    const int index = state_.Find(track);
    if (index >= 0) state_.RemoveLandmark(index);
  }
}

Rigid3 LocalFilter::BeginSubmap() {
  start_.End();
  noise_is_fresh_ = false;
  const Rigid3 old_from_new = state_.Rebase();
  FixScale();
  return old_from_new;
}

Matrix6d LocalFilter::pose_covariance() const {
  // Camera error in the filter's convention, then the translation turned into the camera frame.
  Matrix6d jacobian = state_.motion().DCameraDPose();
  jacobian.topRows<3>() =
      submap_from_camera().rotation.toRotationMatrix().transpose() * jacobian.topRows<3>();
  return jacobian * state_.covariance().topLeftCorner<6, 6>() * jacobian.transpose();
}

std::vector<LandmarkEstimate> LocalFilter::Landmarks() const {
  std::vector<LandmarkEstimate> result;
  result.reserve(state_.landmarks().size());
  const Eigen::Vector3d camera_position = submap_from_camera().translation;
  for (const Landmark& landmark : state_.landmarks()) {
    LandmarkEstimate estimate;
    estimate.track = landmark.track;
    estimate.euclidean = landmark.euclidean;
    estimate.covariance = state_.PointCovariance(landmark);
    if (landmark.euclidean) {
      estimate.point_in_submap = landmark.point_in_submap;
      const Eigen::Vector3d from_camera = landmark.point_in_submap - camera_position;
      const double distance = std::max(from_camera.norm(), 1e-9);
      const Eigen::Vector3d ray = from_camera / distance;
      estimate.inverse_depth = 1.0 / distance;
      estimate.inverse_depth_sigma =
          std::sqrt(std::max(0.0, ray.dot(estimate.covariance * ray))) / (distance * distance);
    } else {
      const int row = state_.Offset(landmark) + 2;
      estimate.point_in_submap = PointOfRay(landmark, state_.AnchorPosition(landmark));
      estimate.inverse_depth = landmark.inverse_depth;
      estimate.inverse_depth_sigma = std::sqrt(state_.covariance()(row, row));
    }
    result.push_back(estimate);
  }
  return result;
}

void LocalFilter::RecordStatistics(const UpdateResult& result) {
  const int inliers = static_cast<int>(result.inliers.size());
  window_.push_back(
      {result.normalised_innovation, inliers, inliers + static_cast<int>(result.outliers.size())});
  if (static_cast<int>(window_.size()) > options_.divergence_window_frames) window_.pop_front();
}

double LocalFilter::WindowNormalisedInnovation() const {
  double sum = 0;
  for (const FrameStatistics& frame : window_) sum += frame.normalised_innovation;
  return window_.empty() ? 0 : sum / window_.size();
}

double LocalFilter::WindowInlierRatio() const {
  int inliers = 0, matches = 0;
  for (const FrameStatistics& frame : window_) {
    inliers += frame.inliers;
    matches += frame.matches;
  }
  return matches == 0 ? 0 : static_cast<double>(inliers) / matches;
}

bool LocalFilter::Diverged() const {
  if (!state_.covariance().topLeftCorner(state_.motion_dim(), state_.motion_dim()).allFinite()) {
    return true;
  }
  if (static_cast<int>(window_.size()) < options_.divergence_window_frames) return false;
  const bool starved = std::all_of(window_.begin(), window_.end(), [&](const auto& frame) {
    return frame.inliers < options_.divergence_min_inliers;
  });
  return starved || WindowNormalisedInnovation() > options_.divergence_max_normalised_innovation ||
         WindowInlierRatio() < options_.divergence_min_inlier_ratio;
}

}  // namespace portolan
