// The stacked, sparse, iterated Kalman update.
#ifndef PORTOLAN_AGENT_FILTER_KALMAN_UPDATE_H_
#define PORTOLAN_AGENT_FILTER_KALMAN_UPDATE_H_

#include <Eigen/Core>
#include <optional>
#include <span>
#include <vector>

#include "agent/filter/filter_state.h"
#include "common/linear_algebra/packed_rows.h"

namespace portolan {

// An image point that is held to show a landmark.
struct Match {
  int landmark = 0;  // index into FilterState::landmarks()
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double variance = 1;  // px^2
  // The caller's number of this match.
  int candidate = 0;
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

// Covariance of the camera's way from the anchor of a ray, about the same for body and camera.
Eigen::Matrix3d ShiftCovariance(const FilterState& state, const LinearMeasurement& measurement);

// The second-order term of a ray's depth: spread of the pixel if the camera's way from the anchor
// has the second moment `shift` about the point of linearisation.
Eigen::Matrix2d DepthShiftCovariance(const FilterState& state, const LinearMeasurement& measurement,
                                     const Eigen::Matrix3d& shift);

// The linear covariance with the second-order term.
Eigen::Matrix2d PredictedCovariance(const FilterState& state, const LinearMeasurement& measurement);

// H_i PHt_j: the 2x2 blocks of the innovation covariance, without the noise.
inline Eigen::Matrix2d TimesPHt(const LinearMeasurement& row,
                                const Eigen::Ref<const Eigen::MatrixXd>& pht, int j) {
  Eigen::Matrix2d block = row.d_pose * pht.block<6, 2>(0, 2 * j);
  block += row.d_landmark * pht.block<3, 2>(row.landmark_offset, 2 * j);
  if (row.anchor_offset != FilterState::kFixed) {
    block += row.d_anchor * pht.block<3, 2>(row.anchor_offset, 2 * j);
  }
  return block;
}

struct KalmanUpdateOptions {
  // Linearisations from each start of Explore, and the scale of its Cauchy cost in sigmas.
  int explore_iterations = 8;
  double explore_cost_sigmas = 2.4;
  // Linearisations of one update (iterated EKF, Bell & Cathey 1993).
  int max_iterations = 4;
  // The update is repeated about its result while the residuals differ from the linear prediction
  // by more than this many sigmas, RMS.
  double nonlinearity_sigmas = 0.3;
  // Matches whose residual after the update is above this chi-square(2) value in the pixel noise
  // contradict the others: they are left out and the update is done again, the worst first.
  double max_residual_chi2 = 13.8;
  int max_rejection_rounds = 3;
};

// Holds the work matrices, allocated once for the largest state and number of measurements, so
// that an update allocates nothing of its own. Thread-compatible.
class KalmanUpdate {
 public:
  KalmanUpdate(const KalmanUpdateOptions& options, int max_dim, int max_measurements);

  // Fills PHt (dim x 2k), which stays valid until the next call of either method.
  void ComputePHt(const FilterState& state, std::span<const LinearMeasurement> measurements);
  auto pht(int dim, int count) const { return pht_.topLeftCorner(dim, 2 * count); }

  // The most likely correction of the state, searched from several camera positions, against
  // wrong matches with a Cauchy cost. For updates that are far from linear because neither the
  // camera's motion nor the depths are known. Afterwards the state is as before.
  struct Exploration {
    Eigen::VectorXd correction;
    std::vector<int> inliers;  // indices of matches
    double cost = 0;
  };
  std::optional<Exploration> Explore(std::span<const Match> matches,
                                     std::span<const Eigen::Vector3d> camera_shifts,
                                     const CameraModel& camera, FilterState* state);

  // State and covariance update with the matches, which must project at the current state; those
  // that contradict the others are removed from *matches. Returns the normalised innovation
  // squared v' S^-1 v (of the last linearisation); no value, and an unchanged state, if S is not
  // positive definite or a landmark ceases to project. The iteration starts from the state
  // corrected by `start`, if given.
  std::optional<double> Apply(std::vector<Match>* matches, const CameraModel& camera,
                              FilterState* state, const Eigen::VectorXd* start = nullptr);

 private:
  // Moves *state to the most likely one given the matches; false if that fails, state undefined
  // but for applied_.
  bool Iterate(std::span<const Match> matches, const CameraModel& camera, FilterState* state);
  // The same with robust weights and a fixed number of steps; returns the robust cost.
  std::optional<double> IterateRobustly(std::span<const Match> matches, const CameraModel& camera,
                                        FilterState* state);
  double RobustCost(std::span<const Match> matches) const;
  // Residuals at the state over the noise, squared, into residuals_.
  bool ComputeResiduals(std::span<const Match> matches, const CameraModel& camera,
                        const FilterState& state);
  bool RejectContradicting(std::vector<Match>* matches) const;
  bool LineariseAll(std::span<const Match> matches, const CameraModel& camera,
                    const FilterState& state);
  // One Gauss-Newton step from the current linearisation; false if S is not positive definite.
  bool Solve(const FilterState& state);
  bool IsLinearEnough(const FilterState& state) const;
  // What the last Solve does to passive landmarks.
  void UpdatePassive(FilterState* state);

  const KalmanUpdateOptions options_;
  std::vector<LinearMeasurement> linear_;
  Eigen::MatrixXd pht_;
  // Of the last Solve: L, and W with the whitened innovation as its last row.
  PackedRows factor_;
  PackedRows gain_;
  // With passive landmarks only.
  Eigen::MatrixXd whitened_rows_;
  PackedRows whitened_;
  Eigen::VectorXd innovation_;
  // Corrections of the prior state by the last and by the new linearisation.
  Eigen::VectorXd applied_;
  Eigen::VectorXd correction_;
  std::vector<Eigen::Vector2d> residuals_;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_FILTER_KALMAN_UPDATE_H_
