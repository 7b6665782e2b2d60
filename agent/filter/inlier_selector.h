// Sorting the matches of a frame into those that agree with one camera motion and the rest.
#ifndef PORTOLAN_AGENT_FILTER_INLIER_SELECTOR_H_
#define PORTOLAN_AGENT_FILTER_INLIER_SELECTOR_H_

#include <memory>
#include <random>
#include <span>
#include <vector>

#include "agent/filter/filter_options.h"
#include "agent/filter/kalman_update.h"

namespace portolan {

struct InlierSet {
  std::vector<int> matches;  // ascending
  int hypotheses = 0;
};

// Thread-compatible; deterministic from its seed.
class InlierSelector {
 public:
  virtual ~InlierSelector() = default;
  // linear[i] belongs to matches[i], all inside the prior gate; pht is P H' of them all.
  virtual InlierSet Select(std::span<const Match> matches,
                           std::span<const LinearMeasurement> linear,
                           const Eigen::Ref<const Eigen::MatrixXd>& pht, const FilterState& state,
                           const CameraModel& camera) = 0;
};

std::unique_ptr<InlierSelector> MakeInlierSelector(const FilterOptions& options);

// 1-point RANSAC (Civera, Grasa, Davison, Montiel, JFR 2010, Alg. 1) with two changes. A hypothesis
// is the state updated with one match; while that leaves the median other match less certain than
// ransac_conditional_variance says (at the start, after a jerk, at low frame rates), further ones
// join it, since a single one cannot tell turn from translation. And the support is counted with
// the covariance of the innovations given the hypothesis, not with the pixel noise alone: both
// agree for well known landmarks, but new ones are not selected by the luck of their prior depth.
// The number of hypotheses adapts to the best share of inliers found.
class OnePointRansac : public InlierSelector {
 public:
  explicit OnePointRansac(const FilterOptions& options);
  InlierSet Select(std::span<const Match> matches, std::span<const LinearMeasurement> linear,
                   const Eigen::Ref<const Eigen::MatrixXd>& pht, const FilterState& state,
                   const CameraModel& camera) override;

 private:
  static constexpr int kMaxPoints = 5;
  struct Problem {
    std::span<const Match> matches;
    std::span<const LinearMeasurement> linear;
    const Eigen::Ref<const Eigen::MatrixXd>& pht;
    const FilterState& state;
    const CameraModel& camera;
  };

  void DrawHypothesis(const Problem& problem);
  void AddPoint(const Problem& problem, int point);
  // Covariance of the innovation of match j, noise included, given the hypothesis.
  Eigen::Matrix2d ConditionalCovariance(const Problem& problem, int j) const;
  bool IsDetermined(const Problem& problem);
  void FindSupport(const Problem& problem);
  int HypothesesNeeded(double inlier_share) const;

  const FilterOptions options_;
  std::mt19937_64 random_;
  std::vector<Eigen::Matrix2d> prior_covariances_;
  std::vector<Eigen::Matrix3d> prior_shifts_;
  // The hypothesis: its points, and with S = L L' of their innovations v: L^-1 v, the rows
  // H_j P H' L^-T of every match and P H' L^-T of the state.
  int points_[kMaxPoints] = {};
  int size_ = 0;
  Eigen::Matrix<double, 2 * kMaxPoints, 1> whitened_innovation_;
  std::vector<Eigen::Matrix<double, 2, 2 * kMaxPoints>> whitened_rows_;
  Eigen::Matrix<double, Eigen::Dynamic, 2 * kMaxPoints> whitened_gain_;
  Eigen::VectorXd correction_;
  std::vector<int> support_;
  std::vector<double> variances_;
};

// Takes every match inside the prior gate.
class ChiSquareOnly : public InlierSelector {
 public:
  InlierSet Select(std::span<const Match> matches, std::span<const LinearMeasurement> linear,
                   const Eigen::Ref<const Eigen::MatrixXd>& pht, const FilterState& state,
                   const CameraModel& camera) override;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_FILTER_INLIER_SELECTOR_H_
