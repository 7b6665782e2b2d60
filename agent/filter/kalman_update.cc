#include "agent/filter/kalman_update.h"

#include <Eigen/Cholesky>

#include "common/base/check.h"

namespace portolan {

std::optional<LinearMeasurement> Linearise(const FilterState& state, const CameraModel& camera,
                                           const Match& match) {
  const Landmark& landmark = state.landmarks()[match.landmark];
  LandmarkProjection projection;
  if (!ProjectLandmark(landmark, state.AnchorPosition(landmark),
                       state.motion().submap_from_camera(), camera, &projection)) {
    return std::nullopt;
  }
  LinearMeasurement linear;
  linear.innovation = match.pixel - projection.pixel;
  linear.variance = match.variance;
  linear.d_pose.noalias() = projection.d_pixel_d_camera * state.motion().DCameraDPose();
  linear.d_landmark = projection.d_pixel_d_landmark;
  linear.d_anchor = projection.d_pixel_d_anchor;
  linear.landmark_offset = state.Offset(landmark);
  linear.anchor_offset = state.AnchorOffset(landmark);
  linear.d_pixel_d_shift = projection.d_pixel_d_shift;
  return linear;
}

Eigen::Matrix2d LinearCovariance(const FilterState& state, const LinearMeasurement& measurement) {
  const auto p = state.covariance();
  const int l = measurement.landmark_offset, a = measurement.anchor_offset;
  const Matrix26d& hp = measurement.d_pose;
  const Matrix23d& hl = measurement.d_landmark;
  const Matrix23d& ha = measurement.d_anchor;
  Eigen::Matrix2d result = hp * p.topLeftCorner<6, 6>() * hp.transpose();
  result += hl * p.block<3, 3>(l, l) * hl.transpose();
  Eigen::Matrix2d cross = hp * p.block<6, 3>(0, l) * hl.transpose();
  if (a != FilterState::kFixed) {
    result += ha * p.block<3, 3>(a, a) * ha.transpose();
    cross += hp * p.block<6, 3>(0, a) * ha.transpose();
    cross += hl * p.block<3, 3>(l, a) * ha.transpose();
  }
  return result + cross + cross.transpose();
}

Eigen::Matrix2d PredictedCovariance(const FilterState& state,
                                    const LinearMeasurement& measurement) {
  const auto p = state.covariance();
  const int l = measurement.landmark_offset, a = measurement.anchor_offset;
  // Uncertainty of the camera's way from the anchor, about the same for body and camera.
  Eigen::Matrix3d shift = p.topLeftCorner<3, 3>();
  if (a != FilterState::kFixed) {
    const Eigen::Matrix3d position_anchor = p.block<3, 3>(0, a);
    shift += p.block<3, 3>(a, a) - position_anchor - position_anchor.transpose();
  }
  const Matrix23d& hs = measurement.d_pixel_d_shift;
  return LinearCovariance(state, measurement) + p(l + 2, l + 2) * (hs * shift * hs.transpose());
}

KalmanUpdate::KalmanUpdate(const KalmanUpdateOptions& options, int max_dim, int max_measurements)
    : options_(options),
      pht_(max_dim, 2 * max_measurements),
      innovation_covariance_(2 * max_measurements, 2 * max_measurements),
      half_gain_(2 * max_measurements, max_dim),
      innovation_(2 * max_measurements),
      applied_(max_dim),
      correction_(max_dim) {
  linear_.reserve(max_measurements);
}

void KalmanUpdate::ComputePHt(const FilterState& state,
                              std::span<const LinearMeasurement> measurements) {
  const int n = state.dim();
  const auto p = state.covariance();
  for (size_t j = 0; j < measurements.size(); ++j) {
    const LinearMeasurement& m = measurements[j];
    auto column = pht_.block(0, 2 * j, n, 2);
    column = p.leftCols<6>().lazyProduct(m.d_pose.transpose());
    column += p.middleCols<3>(m.landmark_offset).lazyProduct(m.d_landmark.transpose());
    if (m.anchor_offset != FilterState::kFixed) {
      column += p.middleCols<3>(m.anchor_offset).lazyProduct(m.d_anchor.transpose());
    }
  }
}

bool KalmanUpdate::LineariseAll(std::span<const Match> matches, const CameraModel& camera,
                                const FilterState& state) {
  linear_.clear();
  const auto applied = applied_.head(state.dim());
  const Eigen::Matrix3d d_rotation = RotationRightJacobian(applied.segment<3>(3));
  for (const Match& match : matches) {
    auto linear = Linearise(state, camera, match);
    if (!linear.has_value()) return false;
    // Derivatives by the correction of the prior state, about which P is.
    linear->d_pose.rightCols<3>() = (linear->d_pose.rightCols<3>() * d_rotation).eval();
    linear->innovation += linear->d_pose * applied.head<6>() +
                          linear->d_landmark * applied.segment<3>(linear->landmark_offset);
    if (linear->anchor_offset != FilterState::kFixed) {
      linear->innovation += linear->d_anchor * applied.segment<3>(linear->anchor_offset);
    }
    linear_.push_back(*linear);
  }
  return true;
}

bool KalmanUpdate::Solve(const FilterState& state) {
  const int count = static_cast<int>(linear_.size()), n = state.dim(), rows = 2 * count;
  ComputePHt(state, linear_);
  const auto pht = pht_.topLeftCorner(n, rows);
  auto s = innovation_covariance_.topLeftCorner(rows, rows);
  auto innovation = innovation_.head(rows);
  for (int i = 0; i < count; ++i) {
    for (int j = 0; j <= i; ++j) s.block<2, 2>(2 * i, 2 * j) = TimesPHt(linear_[i], pht, j);
    s.diagonal().segment<2>(2 * i).array() += linear_[i].variance;
    innovation.segment<2>(2 * i) = linear_[i].innovation;
  }
  // S = L L'. W = L^-1 H P and w = L^-1 v give dx = W'w and P - W'W, symmetric by construction.
  Eigen::Ref<Eigen::MatrixXd> s_ref(s);
  const Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>> llt(s_ref);
  if (llt.info() != Eigen::Success || !innovation.allFinite()) return false;
  auto w = half_gain_.topLeftCorner(rows, n);
  w = pht.transpose();
  llt.matrixL().solveInPlace(w);
  llt.matrixL().solveInPlace(innovation);
  correction_.head(n).noalias() = w.transpose() * innovation;
  return true;
}

bool KalmanUpdate::IsLinearEnough(std::span<const Match> matches, const CameraModel& camera,
                                  const FilterState& state) {
  const Rigid3 camera_pose = state.motion().submap_from_camera();
  const auto correction = correction_.head(state.dim());
  double sum = 0;
  for (size_t i = 0; i < matches.size(); ++i) {
    const Landmark& landmark = state.landmarks()[matches[i].landmark];
    const auto pixel =
        ProjectLandmark(landmark, state.AnchorPosition(landmark), camera_pose, camera);
    if (!pixel.has_value()) return false;
    const LinearMeasurement& linear = linear_[i];
    Eigen::Vector2d expected = linear.innovation - linear.d_pose * correction.head<6>() -
                               linear.d_landmark * correction.segment<3>(linear.landmark_offset);
    if (linear.anchor_offset != FilterState::kFixed) {
      expected -= linear.d_anchor * correction.segment<3>(linear.anchor_offset);
    }
    sum += (matches[i].pixel - *pixel - expected).squaredNorm() / linear.variance;
  }
  const double limit = options_.nonlinearity_sigmas * options_.nonlinearity_sigmas;
  return sum <= limit * 2 * matches.size();
}

std::optional<double> KalmanUpdate::Apply(std::span<const Match> matches, const CameraModel& camera,
                                          FilterState* state) {
  if (matches.empty()) return 0.0;
  const int n = state->dim(), rows = 2 * static_cast<int>(matches.size());
  PORTOLAN_CHECK(rows <= innovation_.size());
  auto applied = applied_.head(n);
  applied.setZero();
  for (int iteration = 1; LineariseAll(matches, camera, *state) && Solve(*state); ++iteration) {
    state->Correct(-applied);
    applied = correction_.head(n);
    state->Correct(applied);
    if (iteration < options_.max_iterations && !IsLinearEnough(matches, camera, *state)) continue;
    auto p = state->covariance();
    const auto w = half_gain_.topLeftCorner(rows, n);
    p.selfadjointView<Eigen::Lower>().rankUpdate(w.transpose(), -1.0);
    p.triangularView<Eigen::StrictlyUpper>() = p.transpose();
    return innovation_.head(rows).squaredNorm();
  }
  state->Correct(-applied);
  return std::nullopt;
}

}  // namespace portolan
