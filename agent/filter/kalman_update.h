// The stacked, sparse, iterated Kalman update.
#ifndef PORTOLAN_AGENT_FILTER_KALMAN_UPDATE_H_
#define PORTOLAN_AGENT_FILTER_KALMAN_UPDATE_H_

#include <Eigen/Core>
#include <optional>
#include <span>
#include <vector>

#include "agent/filter/filter_state.h"

namespace portolan {

// An image point that is held to show a landmark.
struct Match {
  int landmark = 0;  // index into FilterState::landmarks()
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double variance = 1;  // px^2
};

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
  // Rays only, else zero: the pixel moves by d_pixel_d_shift * (position error) * (inverse depth
  // error), the second-order term that matters most: before the first motion it is all that the
  // unknown depth does.
  Matrix23d d_pixel_d_shift = Matrix23d::Zero();
};

// The linearised measurement of a landmark at the current state; no value if it does not project.
std::optional<LinearMeasurement> Linearise(const FilterState& state, const CameraModel& camera,
                                           const Match& match);

// H P H', the covariance of the innovation to first order, without the noise.
Eigen::Matrix2d LinearCovariance(const FilterState& state, const LinearMeasurement& measurement);

// The same with the second-order term of a ray's depth.
Eigen::Matrix2d PredictedCovariance(const FilterState& state, const LinearMeasurement& measurement);

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

struct KalmanUpdateOptions {
  // Linearisations of one update (iterated EKF, Bell & Cathey 1993).
  int max_iterations = 4;
  // The update is repeated about its result while the residuals differ from the linear prediction
  // by more than this many sigmas, RMS.
  double nonlinearity_sigmas = 0.3;
};

// Holds the work matrices, allocated once for the largest state and number of measurements, so
// that an update allocates nothing of its own. Thread-compatible.
class KalmanUpdate {
 public:
  KalmanUpdate(const KalmanUpdateOptions& options, int max_dim, int max_measurements);

  // Fills PHt (dim x 2k), which stays valid until the next call of either method.
  void ComputePHt(const FilterState& state, std::span<const LinearMeasurement> measurements);
  auto pht(int dim, int count) const { return pht_.topLeftCorner(dim, 2 * count); }

  // State and covariance update with all of the matches, which must project at the current state.
  // Returns the normalised innovation squared v' S^-1 v (of the last linearisation); no value, and
  // an unchanged state, if S is not positive definite or a landmark ceases to project.
  std::optional<double> Apply(std::span<const Match> matches, const CameraModel& camera,
                              FilterState* state);

 private:
  bool LineariseAll(std::span<const Match> matches, const CameraModel& camera,
                    const FilterState& state);
  // One Gauss-Newton step from the current linearisation; false if S is not positive definite.
  bool Solve(const FilterState& state);
  bool IsLinearEnough(std::span<const Match> matches, const CameraModel& camera,
                      const FilterState& state);

  const KalmanUpdateOptions options_;
  std::vector<LinearMeasurement> linear_;
  Eigen::MatrixXd pht_;
  Eigen::MatrixXd innovation_covariance_;
  Eigen::MatrixXd half_gain_;
  Eigen::VectorXd innovation_;
  // Corrections of the prior state by the last and by the new linearisation.
  Eigen::VectorXd applied_;
  Eigen::VectorXd correction_;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_FILTER_KALMAN_UPDATE_H_
