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

// A match, its landmark and its linearisation at the predicted state.
struct Match {
  int landmark = 0;  // index into FilterState::landmarks()
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
};

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

// Low-innovation inliers of 1-point RANSAC (Civera, Grasa, Davison, Montiel, JFR 2010, Alg. 1): a
// hypothesis is the state updated with a single match; its support are the matches whose residual
// at that state is within the measurement noise. The number of hypotheses adapts to the best
// share of inliers found. Matches are drawn without repetition.
class OnePointRansac : public InlierSelector {
 public:
  explicit OnePointRansac(const FilterOptions& options);
  InlierSet Select(std::span<const Match> matches, std::span<const LinearMeasurement> linear,
                   const Eigen::Ref<const Eigen::MatrixXd>& pht, const FilterState& state,
                   const CameraModel& camera) override;

 private:
  int HypothesesNeeded(double inlier_share) const;

  const FilterOptions options_;
  std::mt19937_64 random_;
  Eigen::VectorXd correction_;
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
