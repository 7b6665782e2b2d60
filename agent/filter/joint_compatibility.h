// Joint compatibility branch and bound: the largest set of matches that agrees as a whole.
#ifndef PORTOLAN_AGENT_FILTER_JOINT_COMPATIBILITY_H_
#define PORTOLAN_AGENT_FILTER_JOINT_COMPATIBILITY_H_

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "agent/filter/inlier_selector.h"

namespace portolan {

// The value that a chi-square variable of so many degrees of freedom stays below with this
// probability, in (0.5, 1); Wilson & Hilferty's cube, within a percent from two degrees on.
double ChiSquareQuantile(double probability, int degrees_of_freedom);

// JCBB (Neira & Tardos, "Data Association in Stochastic Mapping Using the Joint Compatibility
// Test", T-RA 2001, Alg. 2). The tracker offers one pairing a landmark, so the interpretation tree
// has two branches a match: taken or left. A set is jointly compatible if v' S^-1 v of all its
// innovations, with their cross-covariances, is below the chi-square limit (their Eq. 7); it grows
// by one match at a time, by a row of the Cholesky factor of S (in place of their Eq. 8). Branches
// that cannot hold more matches than the best are cut. Matches are tried in order of their own
// normalised innovation, and after joint_max_nodes pairings the best set so far stands. To the
// blocks on the diagonal the second-order term of unknown depths is added; depths are independent,
// so it has no other blocks. Thread-compatible.
class JointCompatibility : public InlierSelector {
 public:
  explicit JointCompatibility(const FilterOptions& options);
  // InlierSet::hypotheses counts the pairings tried.
  InlierSet Select(std::span<const Match> matches, std::span<const LinearMeasurement> linear,
                   const Eigen::Ref<const Eigen::MatrixXd>& pht, const FilterState& state,
                   const CameraModel& camera) override;

 private:
  // S and v of all matches, those that agree best with their own prediction first.
  void Arrange(std::span<const LinearMeasurement> linear,
               const Eigen::Ref<const Eigen::MatrixXd>& pht, const FilterState& state);
  // Decides on the matches from `level` on, given the chosen ones and their joint distance.
  void Branch(int level, double distance);
  // The joint distance with one more match; no value if S is not positive definite.
  std::optional<double> DistanceWith(int match, double distance);

  const FilterOptions options_;
  std::vector<double> limits_;  // by number of matches
  std::vector<int> order_;      // position in S -> match
  std::vector<Eigen::Matrix2d> own_covariances_;
  std::vector<double> own_distances_;
  Eigen::MatrixXd covariance_;  // S, lower triangle
  Eigen::VectorXd innovation_;
  // Of the chosen ones, positions in S: L and L^-1 v.
  std::vector<int> chosen_;
  Eigen::MatrixXd factor_;
  Eigen::VectorXd whitened_;
  std::vector<int> best_;
  int nodes_ = 0;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_FILTER_JOINT_COMPATIBILITY_H_
