// Bundle adjustment: robust loss, Schur complement, outliers removed between rounds.
#ifndef PORTOLAN_SERVER_REFINEMENT_BUNDLE_ADJUSTER_H_
#define PORTOLAN_SERVER_REFINEMENT_BUNDLE_ADJUSTER_H_

#include <atomic>

#include "common/bundle/bundle_options.h"
#include "common/bundle/bundle_problem.h"

namespace portolan {

struct BundleSummary {
  // False if the solver failed or nothing could be adjusted; the problem is then unchanged.
  bool usable = false;
  bool interrupted = false;
  double initial_cost = 0;
  double final_cost = 0;
  int iterations = 0;
  int inlier_count = 0;
  // Root mean square over the inliers, in sigmas and in pixels (a 2-vector counts once).
  double rms_sigmas = 0;
  double rms_px = 0;
};

// Adjusts the free cameras and points in place and updates the inlier marks of the observations;
// marks come back as well as go. Points with fewer than two inlier observations stay where they
// are. Thread-safe function; deterministic with one thread. `interrupt` may be null; once it
// is true the solve returns with what it has.
BundleSummary AdjustBundle(const BundleOptions& options, const std::atomic<bool>* interrupt,
                           BundleProblem* problem);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_REFINEMENT_BUNDLE_ADJUSTER_H_
