// First stage for an uploaded submap: its own bundle adjustment from its raw observations.
#ifndef PORTOLAN_SERVER_REFINEMENT_SUBMAP_REFINER_H_
#define PORTOLAN_SERVER_REFINEMENT_SUBMAP_REFINER_H_

#include <memory>

#include "common/base/status.h"
#include "common/bundle/triangulation.h"
#include "server/refinement/bundle_adjuster.h"
#include "server/refinement/refined_submap.h"

namespace portolan {

struct SubmapRefinerOptions {
  TriangulationOptions triangulation;
  BundleOptions bundle;
  // Prior of the keyframe positions: the filter's, with this many times its standard deviation,
  // between two shares of the scene's depth. It keeps the scale, and holds the positions of a
  // camera that only turns; where there is parallax, pixels are ten to a hundred times stronger.
  double position_prior_sigmas = 3.0;
  double position_prior_min_of_depth = 0.01;
  double position_prior_max_of_depth = 0.1;
  // A submap with fewer refined landmarks than this cannot be matched or linked reliably.
  int min_landmarks = 15;
  // A keyframe with fewer inlier observations has no pose of its own (six unknowns, and some
  // redundancy to notice wrong ones).
  int min_keyframe_inliers = 8;
  // Under this share of inliers the filter's estimate was wrong, not just inexact. A hand or a
  // person before the camera takes a third of the tracks without spoiling the rest.
  double min_inlier_share = 0.45;
  // Rounds of adjustment and triangulation, two at least.
  int max_rounds = 5;
  // Tries the depth-reversed start as well, which a filter may wrongly have settled in, and for the
  // first submap of a chain, or one that costs more than suspicious_cost an observation, the start
  // from its end (backward_start.h): first a few iterations, which must come under
  // other_trial_cost times the cost that was found, then to the end, where it must come under
  // other_cost times that to be taken. Costs are sums of squared errors in sigmas, truncated at the
  // outlier limit; sound submaps cost 1.4 an observation, what one that began wrong cost was 7.
  bool try_other_starts = true;
  double suspicious_cost = 3.0;
  double other_trial_cost = 1.5;
  double other_cost = 0.97;

  Status Validate() const;
};

// Immutable after creation, thread-safe, deterministic with one solver thread.
class SubmapRefiner {
 public:
  static StatusOr<SubmapRefiner> Create(const SubmapRefinerOptions& options);

  // Always returns a submap; one that cannot be refined has a quarantine reason, the filter's
  // poses and no landmarks.
  std::shared_ptr<const RefinedSubmap> Refine(SubmapId id, std::shared_ptr<const Submap> submap,
                                              std::shared_ptr<const CameraModel> camera) const;

 private:
  explicit SubmapRefiner(const SubmapRefinerOptions& options) : options_(options) {}

  SubmapRefinerOptions options_;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_REFINEMENT_SUBMAP_REFINER_H_
