#include "agent/filter/start_smoother.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "common/base/check.h"
#include "common/linear_algebra/dense.h"

namespace portolan {
namespace {

// Moves the camera and turns it such that points at the given inverse depth stay where they are in
// the middle of the image: direction = R'(ray - inverse_depth p).
void ShiftAtDepth(const Eigen::Vector3d& shift, const Eigen::Vector3d& velocity,
                  double inverse_depth, MotionModel* motion) {
  const Eigen::Matrix3d camera = motion->submap_from_camera().rotation.toRotationMatrix();
  const Eigen::Matrix3d turn = -inverse_depth * camera.transpose() * Skew(camera.col(2));
  Eigen::VectorXd error = Eigen::VectorXd::Zero(motion->error_dim());
  error.head<3>() = shift;
  error.segment<3>(3) = turn * shift;
  motion->Correct(error);
  motion->AddVelocity(velocity, turn * velocity);
}

double CauchyCost(double square, double scale) { return scale * std::log1p(square / scale); }

}  // namespace

Status StartSmootherOptions::Validate() const {
  if (min_frames < 1 || max_frames < 2 || max_frames % 2 != 0 || max_thinnings < 0 ||
      search_iterations < 1 || final_iterations < 1 ||
      !(known_depth_sigma_ratio > 0 && cost_sigmas > 0 && cost_tolerance > 0 &&
        max_residual_chi2 > 0)) {
    return absl::InvalidArgumentError("start smoother: an option is out of range");
  }
  return absl::OkStatus();
}

void StartSmoother::Begin(const MotionModel& motion, const Eigen::MatrixXd& covariance) {
  End();
  if (!options_.enabled) return;
  auto copy = motion.Clone();
  if (copy == nullptr) return;
  motion_dim_ = motion.error_dim();
  const int rest = motion_dim_ - MotionModel::kPoseDim;
  start_information_ = Eigen::MatrixXd::Identity(rest, rest);
  Eigen::MatrixXd p = covariance.bottomRightCorner(rest, rest);
  if (!SolvePositiveDefinite(p, start_information_)) return;
  frames_.push_back({motion.time(), std::move(copy), 1, 1});
}

void StartSmoother::End() {
  frames_.clear();
  points_.clear();
  stride_ = 1;
  skipped_ = thinnings_ = 0;
  noise_factor_ = 1;
}

void StartSmoother::AddPoint(const Observation& first, double inverse_depth, double depth_sigma) {
  if (!active()) return;
  Point point;
  point.track = first.track;
  point.prior_inverse_depth = inverse_depth;
  point.prior_sigma = depth_sigma;
  if (skipped_ == 0) point.sights.push_back({frames(), first.pixel, first.variance});
  points_.push_back(std::move(point));
}

int StartSmoother::NewestPoint(TrackId track) const {
  int number = static_cast<int>(points_.size()) - 1;
  while (number >= 0 && points_[number].track != track) --number;
  return number;
}

bool StartSmoother::AddFrame(const MotionModel& motion, const Prediction& prediction,
                             std::span<const Observation> observations) {
  if (!active()) return false;
  noise_factor_ = std::max(noise_factor_, prediction.noise_factor);
  skipped_ = (skipped_ + 1) % stride_;
  if (skipped_ > 0) return false;
  frames_.push_back(
      {motion.time(), motion.Clone(), prediction.scene_depth, std::exchange(noise_factor_, 1.0)});
  for (const Observation& observation : observations) {
    const int number = NewestPoint(observation.track);
    if (number < 0) continue;
    points_[number].sights.push_back({frames(), observation.pixel, observation.variance});
  }
  return frames() >= options_.max_frames;
}

bool StartSmoother::ThinOut() {
  if (thinnings_ >= options_.max_thinnings || frames() % 2 != 0) return false;
  ++thinnings_;
  stride_ *= 2;
  for (int k = 1; 2 * k <= frames(); ++k) {
    const double left_out = frames_[2 * k - 1].noise_factor;
    std::swap(frames_[k], frames_[2 * k]);
    frames_[k].noise_factor = std::max(frames_[k].noise_factor, left_out);
  }
  frames_.resize(frames() / 2 + 1);
  for (Point& point : points_) {
    std::erase_if(point.sights, [](const Sight& sight) { return sight.frame % 2 != 0; });
    for (Sight& sight : point.sights) sight = {sight.frame / 2, sight.pixel, sight.variance};
  }
  return true;
}

std::vector<std::pair<Timestamp, Rigid3>> StartSmoother::Poses() const {
  std::vector<std::pair<Timestamp, Rigid3>> poses;
  for (const Frame& frame : frames_) {
    poses.emplace_back(frame.time, frame.motion->submap_from_camera());
  }
  return poses;
}

StartSmoother::Estimate StartSmoother::Guess(const CameraModel& camera,
                                             const FilterState& state) const {
  Estimate estimate;
  for (const Frame& frame : frames_) estimate.motions.push_back(frame.motion->Clone());
  for (const Point& point : points_) {
    const Sight& first = point.sights.front();
    const Rigid3 anchor = estimate.motions[first.frame]->submap_from_camera();
    const int index = state.Find(point.track);
    const auto ray =
        MakeRay(point.track, first.pixel, point.prior_inverse_depth, anchor.rotation, camera);
    // It has been a landmark, so it could be unprojected.
    Landmark landmark = ray ? ray->landmark : Landmark{};
    if (index >= 0 && !state.landmarks()[index].euclidean) {
      const Landmark& known = state.landmarks()[index];
      const Eigen::Vector3d direction =
          known.inverse_depth * (state.AnchorPosition(known) - anchor.translation) + known.ray();
      landmark.inverse_depth = known.inverse_depth / direction.norm();
    }
    landmark.anchor = first.frame;
    estimate.landmarks.push_back(landmark);
  }
  return estimate;
}

StartSmoother::Estimate StartSmoother::Copy(const Estimate& estimate) {
  Estimate copy;
  copy.landmarks = estimate.landmarks;
  for (const auto& motion : estimate.motions) copy.motions.push_back(motion->Clone());
  return copy;
}

StartSmoother::Estimate StartSmoother::Reversed(const Estimate& estimate) const {
  Estimate reversed = Copy(estimate);
  double mean = 0;
  for (const Landmark& landmark : estimate.landmarks) {
    mean += landmark.inverse_depth / static_cast<double>(estimate.landmarks.size());
  }
  for (auto& motion : reversed.motions) {
    ShiftAtDepth(-2 * motion->submap_from_camera().translation, -2 * motion->linear_velocity(),
                 mean, motion.get());
  }
  for (Landmark& landmark : reversed.landmarks) {
    landmark.inverse_depth = std::max(2 * mean - landmark.inverse_depth, 0.0);
  }
  return reversed;
}

StartSmoother::Estimate StartSmoother::AtRest(const Estimate& estimate) const {
  Estimate rest = Copy(estimate);
  double mean = 0;
  for (const Landmark& landmark : estimate.landmarks) {
    mean += landmark.inverse_depth / static_cast<double>(estimate.landmarks.size());
  }
  for (auto& motion : rest.motions) {
    ShiftAtDepth(-motion->submap_from_camera().translation, -motion->linear_velocity(), mean,
                 motion.get());
  }
  for (size_t i = 0; i < points_.size(); ++i) {
    rest.landmarks[i].inverse_depth = points_[i].prior_inverse_depth;
  }
  return rest;
}

void StartSmoother::AddMotionTerms(const Estimate& estimate, System* system) const {
  const int n = motion_dim_, rest = n - MotionModel::kPoseDim;
  const Eigen::VectorXd start = frames_[0].motion->ErrorOf(*estimate.motions[0]).tail(rest);
  system->motion.topLeftCorner(rest, rest) += start_information_;
  system->gradient.head(rest) -= start_information_ * start;
  system->cost += start.dot(start_information_ * start);
  MotionModel::MotionMatrix transition, noise;
  for (int k = 1; k <= frames(); ++k) {
    auto predicted = estimate.motions[k - 1]->Clone();
    predicted->Predict(frames_[k].time, frames_[k].scene_depth, &transition, &noise);
    const Eigen::VectorXd error = predicted->ErrorOf(*estimate.motions[k]);
    Eigen::MatrixXd information = Eigen::MatrixXd::Identity(n, n);
    if (!SolvePositiveDefinite(Eigen::MatrixXd(frames_[k].noise_factor * noise), information)) {
      continue;
    }
    // error = new (-) f(old): by the new one about one, by the old one minus the transition.
    Eigen::MatrixXd by_old = -transition, by_new = Eigen::MatrixXd::Identity(n, n);
    by_new.block<3, 3>(3, 3) = RotationRightJacobianInverse(error.segment<3>(3));
    by_old.middleRows<3>(3) =
        (RotationRightJacobianInverse(-error.segment<3>(3)) * by_old.middleRows<3>(3)).eval();
    const int skip = k == 1 ? MotionModel::kPoseDim : 0;
    const int a = Offset(k - 1) + skip, b = Offset(k);
    const Eigen::MatrixXd old = by_old.rightCols(n - skip);
    const Eigen::MatrixXd weighted_old = information * old, weighted_new = information * by_new;
    system->motion.block(a, a, n - skip, n - skip) += old.transpose() * weighted_old;
    system->motion.block(b, b, n, n) += by_new.transpose() * weighted_new;
    const Eigen::MatrixXd cross = by_new.transpose() * weighted_old;
    system->motion.block(b, a, n, n - skip) += cross;
    system->motion.block(a, b, n - skip, n) += cross.transpose();
    system->gradient.segment(a, n - skip) -= weighted_old.transpose() * error;
    system->gradient.segment(b, n) -= weighted_new.transpose() * error;
    system->cost += error.dot(information * error);
  }
}

void StartSmoother::AddSights(const CameraModel& camera, const Estimate& estimate, int point,
                              bool robust, System* system) const {
  const Point& p = points_[point];
  const Landmark& landmark = estimate.landmarks[point];
  const MotionModel& anchor_motion = *estimate.motions[landmark.anchor];
  const Eigen::Vector3d anchor = anchor_motion.submap_from_camera().translation;
  const Eigen::Matrix<double, 3, 6> d_anchor_d_pose = anchor_motion.DCameraDPose().topRows<3>();
  const double scale = options_.cost_sigmas * options_.cost_sigmas;
  Eigen::Matrix3d& own = system->points[point];
  auto gradient = system->point_gradient.segment<3>(3 * point);
  auto cross = system->cross.middleCols<3>(3 * point);
  const double depth_error = landmark.inverse_depth - p.prior_inverse_depth;
  own(2, 2) += 1 / (p.prior_sigma * p.prior_sigma);
  gradient(2) -= depth_error / (p.prior_sigma * p.prior_sigma);
  system->cost += depth_error * depth_error / (p.prior_sigma * p.prior_sigma);
  const int a = Offset(landmark.anchor);
  for (const Sight& sight : p.sights) {
    if (!sight.inlier) continue;
    LandmarkProjection projection;
    const MotionModel& motion = *estimate.motions[sight.frame];
    if (!ProjectLandmark(landmark, anchor, motion.submap_from_camera(), camera, &projection)) {
      system->cost += CauchyCost(1e3, scale);
      continue;
    }
    const Eigen::Vector2d error = projection.pixel - sight.pixel;
    const double square = error.squaredNorm() / sight.variance;
    const double weight = (robust ? 1 / (1 + square / scale) : 1) / sight.variance;
    system->cost += robust ? CauchyCost(square, scale) : square;
    const Matrix26d by_pose = projection.d_pixel_d_camera * motion.DCameraDPose();
    const Matrix26d by_anchor = projection.d_pixel_d_anchor * d_anchor_d_pose;
    const Matrix23d& by_point = projection.d_pixel_d_landmark;
    own += weight * by_point.transpose() * by_point;
    gradient -= weight * by_point.transpose() * error;
    const int b = Offset(sight.frame);
    const bool moves = sight.frame > 0, anchor_moves = landmark.anchor > 0;
    if (moves) {
      system->motion.block<6, 6>(b, b) += weight * by_pose.transpose() * by_pose;
      system->gradient.segment<6>(b) -= weight * by_pose.transpose() * error;
      cross.middleRows<6>(b) += weight * by_pose.transpose() * by_point;
    }
    if (anchor_moves) {
      system->motion.block<6, 6>(a, a) += weight * by_anchor.transpose() * by_anchor;
      system->gradient.segment<6>(a) -= weight * by_anchor.transpose() * error;
      cross.middleRows<6>(a) += weight * by_anchor.transpose() * by_point;
    }
    if (moves && anchor_moves) {
      const Matrix6d both = weight * by_pose.transpose() * by_anchor;
      system->motion.block<6, 6>(b, a) += both;
      system->motion.block<6, 6>(a, b) += both.transpose();
    }
  }
}

void StartSmoother::Build(const CameraModel& camera, const Estimate& estimate, bool robust,
                          System* system) const {
  const int m = motion_unknowns(), n = static_cast<int>(points_.size());
  system->motion.setZero(m, m);
  system->gradient.setZero(m);
  system->cross.setZero(m, 3 * n);
  system->points.assign(n, Eigen::Matrix3d::Zero());
  system->point_gradient.setZero(3 * n);
  system->cost = 0;
  AddMotionTerms(estimate, system);
  for (int i = 0; i < n; ++i) AddSights(camera, estimate, i, robust, system);
}

bool StartSmoother::Step(double damping, System* system, Estimate* estimate) const {
  const std::vector<Eigen::Matrix3d> inverses = Eliminate(damping, system);
  Eigen::VectorXd step = system->gradient - system->by_points * system->point_gradient;
  if (!FactorCholesky(system->reduced)) return false;
  SolveFactored(system->reduced, step);
  const Eigen::VectorXd rest = system->point_gradient - system->cross.transpose() * step;
  if (!step.allFinite() || !rest.allFinite()) return false;
  for (int k = 0; k <= frames(); ++k) {
    Eigen::VectorXd error = Eigen::VectorXd::Zero(motion_dim_);
    const int skip = k == 0 ? MotionModel::kPoseDim : 0;
    error.tail(motion_dim_ - skip) = step.segment(Offset(k) + skip, motion_dim_ - skip);
    estimate->motions[k]->Correct(error);
  }
  for (size_t i = 0; i < points_.size(); ++i) {
    estimate->landmarks[i].Correct(inverses[i] * rest.segment<3>(3 * static_cast<int>(i)));
  }
  return true;
}

std::optional<double> StartSmoother::Minimise(const CameraModel& camera, int iterations,
                                              bool robust, Estimate* estimate) const {
  double damping = 1e-4;
  System system, next;
  Build(camera, *estimate, robust, &system);
  for (int i = 0; i < iterations && damping < 1e3; ++i) {
    Estimate moved = Copy(*estimate);
    next.cost = std::numeric_limits<double>::infinity();
    if (Step(damping, &system, &moved)) Build(camera, moved, robust, &next);
    if (!(next.cost < system.cost)) {
      damping *= 10;
      continue;
    }
    const double decrease = system.cost - next.cost;
    *estimate = std::move(moved);
    std::swap(system, next);
    damping *= 0.1;
    if (decrease < options_.cost_tolerance * (1 + system.cost)) break;
  }
  if (!std::isfinite(system.cost)) return std::nullopt;
  return system.cost;
}

void StartSmoother::MarkInliers(const CameraModel& camera, const Estimate& estimate) {
  for (size_t i = 0; i < points_.size(); ++i) {
    const Landmark& landmark = estimate.landmarks[i];
    const Eigen::Vector3d anchor =
        estimate.motions[landmark.anchor]->submap_from_camera().translation;
    bool any = false;
    for (Sight& sight : points_[i].sights) {
      const auto pixel = ProjectLandmark(
          landmark, anchor, estimate.motions[sight.frame]->submap_from_camera(), camera);
      sight.inlier = pixel && (*pixel - sight.pixel).squaredNorm() <
                                  options_.max_residual_chi2 * sight.variance;
      any |= sight.inlier;
    }
    // Without any its direction would be free, and the system singular.
    if (!any) points_[i].sights.front().inlier = true;
  }
}

bool StartSmoother::Solve(const CameraModel& camera, FilterState* state) {
  if (frames() < 1 || !at_frame()) return false;
  // A point that was never seen in a frame that is kept tells nothing; nor does one whose oldest
  // kept sight is outside of the lens's model.
  std::erase_if(points_, [&](const Point& point) {
    return point.sights.empty() || !camera.Unproject(point.sights.front().pixel);
  });
  std::optional<Estimate> best;
  double best_cost = 0;
  const auto attempt = [&](Estimate guess) {
    const auto cost = Minimise(camera, options_.search_iterations, true, &guess);
    if (!cost || (best && *cost >= best_cost)) return;
    best_cost = *cost;
    best = std::move(guess);
  };
  for (Point& point : points_) {
    for (Sight& sight : point.sights) sight.inlier = true;
  }
  attempt(Guess(camera, *state));
  if (!best) return false;
  attempt(AtRest(*best));
  attempt(Reversed(*best));
  MarkInliers(camera, *best);
  if (!Minimise(camera, options_.final_iterations, false, &*best)) return false;
  if (!WriteTo(camera, *best, state)) return false;
  for (int k = 0; k <= frames(); ++k) frames_[k].motion = std::move(best->motions[k]);
  return true;
}

std::vector<Eigen::Matrix3d> StartSmoother::Eliminate(double damping, System* system) {
  const int n = static_cast<int>(system->points.size());
  std::vector<Eigen::Matrix3d> inverses(n);
  system->by_points.resize(system->motion.rows(), 3 * n);
  for (int i = 0; i < n; ++i) {
    Eigen::Matrix3d own = system->points[i];
    own.diagonal() *= 1 + damping;
    inverses[i] = own.inverse();
    system->by_points.middleCols<3>(3 * i) = system->cross.middleCols<3>(3 * i) * inverses[i];
  }
  system->reduced = system->motion;
  system->reduced.diagonal() *= 1 + damping;
  AddProductTransposed(-1, system->by_points, system->cross, system->reduced);
  return inverses;
}

std::vector<int> StartSmoother::CollectRays(const Estimate& estimate, const FilterState& state,
                                            FilterState::RayEstimates* rays) const {
  std::vector<int> numbers, anchor_of_frame(frames_.size(), -1), frame_of_anchor;
  for (const Landmark& landmark : state.landmarks()) {
    const int number = NewestPoint(landmark.track);
    if (number < 0) continue;
    numbers.push_back(number);
    rays->landmarks.push_back(estimate.landmarks[number]);
    const int frame = estimate.landmarks[number].anchor;
    if (anchor_of_frame[frame] < 0) {
      anchor_of_frame[frame] = static_cast<int>(rays->anchors.size());
      frame_of_anchor.push_back(frame);
      rays->anchors.push_back(
          {estimate.motions[frame]->submap_from_camera().translation, FilterState::kFixed, 0});
    }
    rays->landmarks.back().anchor = anchor_of_frame[frame];
  }
  int block = static_cast<int>(numbers.size());
  for (size_t i = 0; i < rays->anchors.size(); ++i) {
    if (frame_of_anchor[i] > 0) rays->anchors[i].block = block++;
  }
  return numbers;
}

bool StartSmoother::WriteTo(const CameraModel& camera, const Estimate& estimate,
                            FilterState* state) const {
  System system;
  Build(camera, estimate, false, &system);
  const std::vector<Eigen::Matrix3d> inverses = Eliminate(0, &system);
  if (!FactorCholesky(system.reduced)) return false;
  FilterState::RayEstimates rays;
  const std::vector<int> numbers = CollectRays(estimate, *state, &rays);
  // Errors of the new state by those of the motion states, columns; the covariance is their Gram
  // matrix in the inverse information, and what the points have of their own.
  const auto row_of = [this](int block) { return motion_dim_ + 3 * block; };
  int blocks = static_cast<int>(numbers.size());
  for (const Anchor& anchor : rays.anchors) blocks += anchor.block == FilterState::kFixed ? 0 : 1;
  Eigen::MatrixXd columns = Eigen::MatrixXd::Zero(motion_unknowns(), row_of(blocks));
  columns.block(Offset(frames()), 0, motion_dim_, motion_dim_).setIdentity();
  for (size_t i = 0; i < numbers.size(); ++i) {
    columns.middleCols<3>(row_of(static_cast<int>(i))) =
        -system.by_points.middleCols<3>(3 * numbers[i]);
    const int frame = estimate.landmarks[numbers[i]].anchor;
    const int block = rays.anchors[rays.landmarks[i].anchor].block;
    if (block == FilterState::kFixed) continue;
    columns.block(Offset(frame), row_of(block), 6, 3) =
        estimate.motions[frame]->DCameraDPose().topRows<3>().transpose();
  }
  SolveLower(system.reduced, columns);
  rays.covariance = TransposedProduct(columns, columns);
  for (size_t i = 0; i < numbers.size(); ++i) {
    const int row = row_of(static_cast<int>(i));
    rays.covariance.block<3, 3>(row, row) += inverses[numbers[i]];
  }
  if (!rays.covariance.allFinite()) return false;
  state->Restate(state->motion().ErrorOf(*estimate.motions.back()), rays);
  return true;
}

}  // namespace portolan
