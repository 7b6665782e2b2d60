// Pairwise consistent measurement set maximisation: Mangelson, Dominic, Eustice, Vasudevan,
// "Pairwise consistent measurement set maximization for robust multi-robot map merging", ICRA 2018.
#ifndef PORTOLAN_SERVER_VERIFICATION_PAIRWISE_CONSISTENCY_H_
#define PORTOLAN_SERVER_VERIFICATION_PAIRWISE_CONSISTENCY_H_

#include <cstddef>
#include <functional>
#include <optional>
#include <vector>

#include "common/base/status.h"
#include "common/base/strong_id.h"
#include "common/geometry/similarity3.h"
#include "server/verification/closure.h"

namespace portolan {

struct PairwiseConsistencyOptions {
  // Two closures agree if the Mahalanobis distance squared of the loop through both lies under
  // this. Chi-square, 7 degrees of freedom: 18.48 is 99 %.
  double max_mahalanobis_squared = 18.48;
  // Added to the loop's covariance, per component of the tangent: translation relative to the
  // loop's largest translation, rotation, log scale. Covers what the covariances do not know
  // (correlated landmarks, imperfect calibration).
  double translation_floor = 0.01;
  double rotation_floor_rad = 0.01;
  double log_scale_floor = 0.02;
  // Sets up to this size are searched exactly (branch and bound); the search visits at most
  // max_branches nodes and then keeps the best it has, which starts from the greedy answer.
  int max_branches = 200000;

  Status Validate() const;
};

// A relative transform with the covariance of its right perturbation [translation; rotation; log
// scale].
struct UncertainSimilarity {
  Similarity3 a_from_b;
  Matrix7d covariance = Matrix7d::Zero();
};

// The chain of known relations (odometry, earlier accepted closures) inside one component:
// returns a_from_b with covariance, or no value if a and b are not in one component. Called with
// a == b as well, where it may return identity and zero.
using RelativeSimilarity =
    std::function<std::optional<UncertainSimilarity>(SubmapId a, SubmapId b)>;

// Mahalanobis distance squared of the loop a1 <- b1 <- b2 <- a2 <- a1 from the identity (Eq. 4), or
// no value if the relations between the ends are unknown. The ends of `second` are exchanged when
// that is what makes the loop close within components.
std::optional<double> LoopMahalanobisSquared(const Closure& first, const Closure& second,
                                             const RelativeSimilarity& relative,
                                             const PairwiseConsistencyOptions& options);

// Indices (ascending) of the largest set of closures that agree pairwise: a maximum clique of the
// consistency graph. Closures whose loop cannot be computed do not agree. Ties: the set with the
// larger number of landmark matches, then the lexicographically smallest.
std::vector<size_t> LargestConsistentSet(const std::vector<Closure>& closures,
                                         const RelativeSimilarity& relative,
                                         const PairwiseConsistencyOptions& options);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_VERIFICATION_PAIRWISE_CONSISTENCY_H_
