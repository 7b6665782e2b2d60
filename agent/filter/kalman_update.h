// The stacked, sparse Kalman update.
#ifndef PORTOLAN_AGENT_FILTER_KALMAN_UPDATE_H_
#define PORTOLAN_AGENT_FILTER_KALMAN_UPDATE_H_

#include <Eigen/Core>
#include <optional>
#include <span>

#include "agent/filter/filter_state.h"

namespace portolan {

// One linearised image measurement. Its row of H is non-zero for the pose, the landmark's block
// and, for a ray with an uncertain anchor, the anchor's.
struct LinearMeasurement {
  Eigen::Vector2d innovation = Eigen::Vector2d::Zero();
  double variance = 1;
  Matrix26d d_pose = Matrix26d::Zero();
  Matrix23d d_landmark = Matrix23d::Zero();
  Matrix23d d_anchor = Matrix23d::Zero();
  int landmark_offset = 0;
  int anchor_offset = FilterState::kFixed;
};

// The linearised measurement of a landmark at the current state; no value if it does not project.
std::optional<LinearMeasurement> Linearise(const FilterState& state, const Landmark& landmark,
                                           const CameraModel& camera, const Eigen::Vector2d& pixel,
                                           double variance);

// H P H' of one measurement, without the noise.
Eigen::Matrix2d PredictedCovariance(const FilterState& state, const LinearMeasurement& measurement);

// Holds the work matrices, allocated once for the largest state and number of measurements, so
// that an update allocates nothing of its own. Thread-compatible.
class KalmanUpdate {
 public:
  KalmanUpdate(int max_dim, int max_measurements);

  // Fills PHt (dim x 2k), which stays valid until the state changes.
  void ComputePHt(const FilterState& state, std::span<const LinearMeasurement> measurements);
  auto pht(int count) const { return pht_.leftCols(2 * count); }

  // State and covariance update with all of the measurements. Returns the normalised innovation
  // squared v' S^-1 v; no value, and an unchanged state, if S is not positive definite.
  std::optional<double> Apply(std::span<const LinearMeasurement> measurements, FilterState* state);

 private:
  Eigen::MatrixXd pht_;
  Eigen::MatrixXd innovation_covariance_;
  Eigen::MatrixXd half_gain_;
  Eigen::VectorXd innovation_;
  Eigen::VectorXd correction_;
};

// H_i PHt_j: the 2x2 blocks of the innovation covariance, without the noise.
template <typename Derived>
Eigen::Matrix2d TimesPHt(const LinearMeasurement& row, const Eigen::MatrixBase<Derived>& pht,
                         int j) {
  Eigen::Matrix2d block = row.d_pose * pht.template block<6, 2>(0, 2 * j);
  block += row.d_landmark * pht.template block<3, 2>(row.landmark_offset, 2 * j);
  if (row.anchor_offset != FilterState::kFixed) {
    block += row.d_anchor * pht.template block<3, 2>(row.anchor_offset, 2 * j);
  }
  return block;
}

}  // namespace portolan

#endif  // PORTOLAN_AGENT_FILTER_KALMAN_UPDATE_H_
