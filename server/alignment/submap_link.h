// The relation of a submap to its connected predecessor.
#ifndef PORTOLAN_SERVER_ALIGNMENT_SUBMAP_LINK_H_
#define PORTOLAN_SERVER_ALIGNMENT_SUBMAP_LINK_H_

#include "common/base/status.h"
#include "common/geometry/similarity3.h"
#include "server/refinement/refined_submap.h"

namespace portolan {

struct SubmapLinkOptions {
  // Scale of the successor relative to the predecessor where no shared landmark tells: the filter
  // carries its landmarks over, so it is 1 within this (log).
  double carried_log_scale_sigma = 0.05;
  // Under this, shared landmarks with equal errors (one image, one lens) would be overrated.
  double min_log_scale_sigma = 0.002;
  // Floors of the pose's standard deviations, for the same reason; translation relative to the
  // scene's depth.
  double min_rotation_sigma_rad = 0.001;
  double min_translation_sigma_of_depth = 0.001;

  Status Validate() const;
};

// A relative similarity of two submaps with the information of its right perturbation
// [translation; rotation; log scale].
struct SubmapRelation {
  SubmapId a;
  SubmapId b;
  Similarity3 a_from_b;
  Matrix7d information = Matrix7d::Identity();
};

// predecessor_from_successor: rotation and translation are those of the shared keyframe, the scale
// is a robust mean over the ranges of the shared landmarks from it. So it is for metric submaps,
// whose own scales are known to a percent or two, shared landmarks far better.
// Neither submap is quarantined.
SubmapRelation LinkToPredecessor(const SubmapLinkOptions& options, const RefinedSubmap& predecessor,
                                 const RefinedSubmap& successor);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_ALIGNMENT_SUBMAP_LINK_H_
