#include "agent/filter/kalman_update.h"

#include <algorithm>
#include <cmath>

#include "common/base/check.h"
#include "common/linear_algebra/dense.h"

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

Eigen::Matrix3d ShiftCovariance(const FilterState& state, const LinearMeasurement& measurement) {
  const auto p = state.covariance();
  const int a = measurement.anchor_offset;
  Eigen::Matrix3d shift = p.topLeftCorner<3, 3>();
  if (a != FilterState::kFixed) {
    const Eigen::Matrix3d position_anchor = p.block<3, 3>(0, a);
    shift += p.block<3, 3>(a, a) - position_anchor - position_anchor.transpose();
  }
  return shift;
}

Eigen::Matrix2d DepthShiftCovariance(const FilterState& state, const LinearMeasurement& measurement,
                                     const Eigen::Matrix3d& shift) {
  const int rho = measurement.landmark_offset + 2;
  const Matrix23d& hs = measurement.d_pixel_d_shift;
  return state.covariance()(rho, rho) * (hs * shift * hs.transpose());
}

Eigen::Matrix2d PredictedCovariance(const FilterState& state,
                                    const LinearMeasurement& measurement) {
  return LinearCovariance(state, measurement) +
         DepthShiftCovariance(state, measurement, ShiftCovariance(state, measurement));
}

KalmanUpdate::KalmanUpdate(const KalmanUpdateOptions& options, int max_dim, int max_measurements)
    : options_(options),
      pht_(max_dim, 2 * max_measurements),
      innovation_(2 * max_measurements),
      applied_(max_dim),
      correction_(max_dim) {
  linear_.reserve(max_measurements);
  residuals_.reserve(max_measurements);
}

void KalmanUpdate::ComputePHt(const FilterState& state,
                              std::span<const LinearMeasurement> measurements) {
  const int n = state.active_dim();
  const auto p = state.active_covariance();
  for (size_t j = 0; j < measurements.size(); ++j) {
    const LinearMeasurement& m = measurements[j];
    WeightedColumn columns[12];
    int count = 0;
    const auto add = [&](int first, const auto& d_pixel) {
      for (int i = 0; i < d_pixel.cols(); ++i) {
        columns[count++] = {p.col(first + i).data(), {d_pixel(0, i), d_pixel(1, i)}};
      }
    };
    add(0, m.d_pose);
    add(m.landmark_offset, m.d_landmark);
    if (m.anchor_offset != FilterState::kFixed) add(m.anchor_offset, m.d_anchor);
    CombineColumns(columns, count, n, &pht_(0, 2 * j), &pht_(0, 2 * j + 1));
  }
}

bool KalmanUpdate::LineariseAll(std::span<const Match> matches, const CameraModel& camera,
                                const FilterState& state) {
  linear_.clear();
  const auto applied = applied_.head(state.active_dim());
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
  const int count = static_cast<int>(linear_.size()), n = state.active_dim(), rows = 2 * count;
  ComputePHt(state, linear_);
  const ConstMatrixView pht = pht_.topLeftCorner(n, rows);
  factor_.SetZero(rows, rows);
  // The innovation is a row of its own after the state's.
  gain_.SetZero(n + 1, rows);
  gain_.SetTopRows(pht);
  for (int i = 0; i < count; ++i) {
    for (int j = 0; j <= i; ++j) {
      const Eigen::Matrix2d s = TimesPHt(linear_[i], pht, j);
      for (int k = 0; k < 4; ++k) factor_(2 * i + k / 2, 2 * j + k % 2) = s(k / 2, k % 2);
    }
    for (int k = 2 * i; k < 2 * i + 2; ++k) {
      factor_(k, k) += linear_[i].variance;
      gain_(n, k) = linear_[i].innovation[k - 2 * i];
      if (!std::isfinite(gain_(n, k))) return false;
    }
  }
  // S = L L'. W = P H' L^-T and w = L^-1 v give dx = W w and P - W W', symmetric by construction.
  if (!FactorCholesky(&factor_)) return false;
  SolveRight(factor_, &gain_);
  innovation_.head(rows) = gain_.Row(n);
  SetToProduct(gain_, innovation_, correction_.head(n));
  return true;
}

bool KalmanUpdate::ComputeResiduals(std::span<const Match> matches, const CameraModel& camera,
                                    const FilterState& state) {
  const Rigid3 camera_pose = state.motion().submap_from_camera();
  residuals_.clear();
  for (const Match& match : matches) {
    const Landmark& landmark = state.landmarks()[match.landmark];
    const auto pixel =
        ProjectLandmark(landmark, state.AnchorPosition(landmark), camera_pose, camera);
    if (!pixel.has_value()) return false;
    residuals_.push_back(match.pixel - *pixel);
  }
  return true;
}

bool KalmanUpdate::IsLinearEnough(const FilterState& state) const {
  const auto correction = correction_.head(state.active_dim());
  double sum = 0;
  for (size_t i = 0; i < linear_.size(); ++i) {
    const LinearMeasurement& linear = linear_[i];
    Eigen::Vector2d expected = linear.innovation - linear.d_pose * correction.head<6>() -
                               linear.d_landmark * correction.segment<3>(linear.landmark_offset);
    if (linear.anchor_offset != FilterState::kFixed) {
      expected -= linear.d_anchor * correction.segment<3>(linear.anchor_offset);
    }
    sum += (residuals_[i] - expected).squaredNorm() / linear.variance;
  }
  const double limit = options_.nonlinearity_sigmas * options_.nonlinearity_sigmas;
  return sum <= limit * 2 * linear_.size();
}

bool KalmanUpdate::Iterate(std::span<const Match> matches, const CameraModel& camera,
                           FilterState* state) {
  auto applied = applied_.head(state->active_dim());
  for (int iteration = 1; LineariseAll(matches, camera, *state) && Solve(*state); ++iteration) {
    state->Correct(-applied);
    applied = correction_.head(state->active_dim());
    state->Correct(applied);
    if (!ComputeResiduals(matches, camera, *state)) return false;
    if (iteration >= options_.max_iterations || IsLinearEnough(*state)) return true;
  }
  return false;
}

bool KalmanUpdate::RejectContradicting(std::vector<Match>* matches) const {
  double worst = 0;
  for (size_t i = 0; i < matches->size(); ++i) {
    worst = std::max(worst, residuals_[i].squaredNorm() / (*matches)[i].variance);
  }
  if (worst <= options_.max_residual_chi2) return false;
  // A bad match spoils the residuals of the good ones, so only those like the worst go at once.
  const double limit = std::max(options_.max_residual_chi2, 0.25 * worst);
  size_t kept = 0;
  for (size_t i = 0; i < matches->size(); ++i) {
    if (residuals_[i].squaredNorm() / (*matches)[i].variance <= limit) {
      (*matches)[kept++] = (*matches)[i];
    }
  }
  matches->resize(kept);
  return true;
}

double KalmanUpdate::RobustCost(std::span<const Match> matches) const {
  // v' S^-1 v is the cost of the prior plus that of the weighted residuals.
  const double scale = options_.explore_cost_sigmas * options_.explore_cost_sigmas;
  double cost = innovation_.head(2 * matches.size()).squaredNorm();
  for (size_t i = 0; i < matches.size(); ++i) {
    const double square = residuals_[i].squaredNorm() / matches[i].variance;
    cost += scale * std::log1p(square / scale) - residuals_[i].squaredNorm() / linear_[i].variance;
  }
  return cost;
}

std::optional<double> KalmanUpdate::IterateRobustly(std::span<const Match> matches,
                                                    const CameraModel& camera, FilterState* state) {
  const double scale = options_.explore_cost_sigmas * options_.explore_cost_sigmas;
  auto applied = applied_.head(state->active_dim());
  for (int iteration = 0; iteration < options_.explore_iterations; ++iteration) {
    if (!ComputeResiduals(matches, camera, *state)) return std::nullopt;
    if (!LineariseAll(matches, camera, *state)) return std::nullopt;
    for (size_t i = 0; i < matches.size() && iteration > 0; ++i) {
      const double square = residuals_[i].squaredNorm() / matches[i].variance;
      linear_[i].variance = matches[i].variance * (1 + square / scale);
    }
    if (!Solve(*state)) return std::nullopt;
    state->Correct(-applied);
    applied = correction_.head(state->active_dim());
    state->Correct(applied);
  }
  if (!ComputeResiduals(matches, camera, *state)) return std::nullopt;
  return RobustCost(matches);
}

std::optional<KalmanUpdate::Exploration> KalmanUpdate::Explore(
    std::span<const Match> matches, std::span<const Eigen::Vector3d> camera_shifts,
    const CameraModel& camera, FilterState* state) {
  PORTOLAN_CHECK(2 * static_cast<int>(matches.size()) <= innovation_.size());
  std::optional<Exploration> best;
  auto applied = applied_.head(state->active_dim());
  for (const Eigen::Vector3d& shift : camera_shifts) {
    applied.setZero();
    applied.head<3>() = shift;
    state->Correct(applied);
    const auto cost = IterateRobustly(matches, camera, state);
    state->Correct(-applied);
    if (!cost || (best && *cost >= best->cost)) continue;
    best = Exploration{applied, {}, *cost};
    for (size_t i = 0; i < matches.size(); ++i) {
      if (residuals_[i].squaredNorm() < options_.max_residual_chi2 * matches[i].variance) {
        best->inliers.push_back(static_cast<int>(i));
      }
    }
  }
  return best;
}

void KalmanUpdate::UpdatePassive(FilterState* state) {
  const int count = static_cast<int>(linear_.size()), n = state->active_dim(), rows = 2 * count;
  const auto factor = state->passive_factor();
  whitened_rows_.resize(rows, n);
  for (int i = 0; i < count; ++i) {
    const LinearMeasurement& m = linear_[i];
    auto row = whitened_rows_.middleRows<2>(2 * i);
    row.noalias() = m.d_pose * factor.topRows<6>();
    row.noalias() += m.d_landmark * factor.middleRows<3>(m.landmark_offset);
    if (m.anchor_offset != FilterState::kFixed) {
      row.noalias() += m.d_anchor * factor.middleRows<3>(m.anchor_offset);
    }
  }
  whitened_.SetZero(n, rows);
  whitened_.SetTopRows(whitened_rows_.transpose());
  SolveRight(factor_, &whitened_);
  state->UpdatePassive(gain_.TopRows(n).transpose(), whitened_.TopRows(n).transpose(),
                       innovation_.head(rows));
}

std::optional<double> KalmanUpdate::Apply(std::vector<Match>* matches, const CameraModel& camera,
                                          FilterState* state, const Eigen::VectorXd* start) {
  const int n = state->active_dim();
  PORTOLAN_CHECK(2 * static_cast<int>(matches->size()) <= innovation_.size());
  applied_.head(n).setZero();
  if (start != nullptr) {
    applied_.head(n) = *start;
    state->Correct(*start);
  }
  for (int round = 0; !matches->empty() && Iterate(*matches, camera, state); ++round) {
    if (round < options_.max_rejection_rounds && RejectContradicting(matches)) continue;
    const int rows = 2 * static_cast<int>(matches->size());
    if (state->passive_count() > 0) UpdatePassive(state);
    SubtractGram(gain_, state->active_covariance());
    return innovation_.head(rows).squaredNorm();
  }
  state->Correct(-applied_.head(n));
  return std::nullopt;
}

}  // namespace portolan
