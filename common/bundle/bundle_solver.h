// Levenberg-Marquardt for bundle adjustment: the points eliminated, the cameras' system dense or
// sparse (Triggs, McLauchlan, Hartley, Fitzgibbon, "Bundle adjustment - a modern synthesis", 2000,
// Sec. 6), everything in fixed-size blocks and without a graph to set up. The server spends most of
// its time here, the agent adjusts its last keyframes with it.
#ifndef PORTOLAN_COMMON_BUNDLE_BUNDLE_SOLVER_H_
#define PORTOLAN_COMMON_BUNDLE_BUNDLE_SOLVER_H_

#include <Eigen/Core>
#include <atomic>
#include <optional>

#include "common/bundle/bundle_parameters.h"

namespace portolan {

// Minimises the observations' robust losses and the priors over the free cameras, points and
// lenses, from and into `parameters`. `interrupt` may be null. Deterministic.
BundleSolve SolveBundle(const BundleOptions& options, const BundleProblem& problem,
                        const std::atomic<bool>* interrupt, BundleParameters* parameters);

// Covariance of a lens where the problem is, of the prior and of all that is free in
// the problem together; no value if the cameras are not determined.
std::optional<LensMatrix> LensCovariance(const BundleOptions& options, const BundleProblem& problem,
                                         int lens);

}  // namespace portolan

#endif  // PORTOLAN_COMMON_BUNDLE_BUNDLE_SOLVER_H_
