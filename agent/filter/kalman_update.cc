#include "agent/filter/kalman_update.h"

#include <Eigen/Cholesky>

#include "common/base/check.h"

namespace portolan {

std::optional<LinearMeasurement> Linearise(const FilterState& state, const Landmark& landmark,
                                           const CameraModel& camera, const Eigen::Vector2d& pixel,
                                           double variance) {
  LandmarkProjection projection;
  if (!ProjectLandmark(landmark, state.AnchorPosition(landmark),
                       state.motion().submap_from_camera(), camera, &projection)) {
    return std::nullopt;
  }
  LinearMeasurement linear;
  linear.innovation = pixel - projection.pixel;
  linear.variance = variance;
  linear.d_pose.noalias() = projection.d_pixel_d_camera * state.motion().DCameraDPose();
  linear.d_landmark = projection.d_pixel_d_landmark;
  linear.d_anchor = projection.d_pixel_d_anchor;
  linear.landmark_offset = state.Offset(landmark);
  linear.anchor_offset = state.AnchorOffset(landmark);
  return linear;
}

Eigen::Matrix2d PredictedCovariance(const FilterState& state,
                                    const LinearMeasurement& measurement) {
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

KalmanUpdate::KalmanUpdate(int max_dim, int max_measurements)
    : pht_(max_dim, 2 * max_measurements),
      innovation_covariance_(2 * max_measurements, 2 * max_measurements),
      half_gain_(2 * max_measurements, max_dim),
      innovation_(2 * max_measurements),
      correction_(max_dim) {}

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

std::optional<double> KalmanUpdate::Apply(std::span<const LinearMeasurement> measurements,
                                          FilterState* state) {
  const int count = static_cast<int>(measurements.size());
  if (count == 0) return 0.0;
  PORTOLAN_CHECK(2 * count <= innovation_.size());
  const int n = state->dim(), rows = 2 * count;
  ComputePHt(*state, measurements);
  const auto pht = pht_.topLeftCorner(n, rows);
  auto s = innovation_covariance_.topLeftCorner(rows, rows);
  auto innovation = innovation_.head(rows);
  for (int i = 0; i < count; ++i) {
    for (int j = 0; j <= i; ++j) {
      s.block<2, 2>(2 * i, 2 * j) = TimesPHt(measurements[i], pht, j);
    }
    s.diagonal().segment<2>(2 * i).array() += measurements[i].variance;
    innovation.segment<2>(2 * i) = measurements[i].innovation;
  }

  // S = L L'. W = L^-1 H P and w = L^-1 v give dx = W'w and P - W'W, symmetric by construction.
  Eigen::Ref<Eigen::MatrixXd> s_ref(s);
  const Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>> llt(s_ref);
  if (llt.info() != Eigen::Success || !innovation.allFinite()) return std::nullopt;
  auto w = half_gain_.topLeftCorner(rows, n);
  w = pht.transpose();
  llt.matrixL().solveInPlace(w);
  llt.matrixL().solveInPlace(innovation);
  auto correction = correction_.head(n);
  correction.noalias() = w.transpose() * innovation;

  auto p = state->covariance();
  p.selfadjointView<Eigen::Lower>().rankUpdate(w.transpose(), -1.0);
  p.triangularView<Eigen::StrictlyUpper>() = p.transpose();
  state->Correct(correction);
  return innovation.squaredNorm();
}

}  // namespace portolan
