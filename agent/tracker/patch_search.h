// Finds a lost patch again in a region of the image.
#ifndef PORTOLAN_AGENT_TRACKER_PATCH_SEARCH_H_
#define PORTOLAN_AGENT_TRACKER_PATCH_SEARCH_H_

#include <Eigen/Core>
#include <optional>

#include "agent/tracker/image_pyramid.h"
#include "agent/tracker/reference_patch.h"

namespace portolan {

struct PatchSearchOptions {
  // Least correlation after alignment.
  double min_correlation = 0.85;
  // A second place this close in correlation makes the answer ambiguous: none is given.
  double min_lead = 0.03;
  // Radius searched at most, pixels.
  double max_radius_px = 40.0;
};

// Active search (Davison et al., PAMI 2007, Sec. 3.4): zero-mean normalised cross-correlation of
// the warped patch at every pixel of the 3-sigma ellipse about expected.pixel, then alignment of
// the best places. No value if none is good enough or two are about equally good.
std::optional<PatchAlignment> SearchPatch(const ImagePyramid& image,
                                          const ReferencePatch& reference,
                                          const PatchPose& expected,
                                          const Eigen::Matrix2d& covariance_px2,
                                          const PatchSearchOptions& options);

}  // namespace portolan

#endif  // PORTOLAN_AGENT_TRACKER_PATCH_SEARCH_H_
