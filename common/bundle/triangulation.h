// Multi-view triangulation of one track from known camera poses, robust against wrong sights.
#ifndef PORTOLAN_COMMON_BUNDLE_TRIANGULATION_H_
#define PORTOLAN_COMMON_BUNDLE_TRIANGULATION_H_

#include <optional>
#include <vector>

#include "common/base/status.h"
#include "common/bundle/bundle_terms.h"

namespace portolan {

struct TriangulationOptions {
  // A sight agrees with a point if its squared error in sigmas is under this. Generous, because
  // the poses still come from the filter.
  double inlier_chi2 = 40.0;
  // Gauss-Newton steps on the agreeing sights; it converges quadratically from the best pair.
  int max_iterations = 6;
  // How far "infinity" is, in scene depths.
  double far_scene_depths = 100.0;

  Status Validate() const;
};

struct TrackSight {
  CameraReference camera;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double sigma_px = 1.0;
};

struct TriangulatedPoint {
  Eigen::Vector3d point_in_world = Eigen::Vector3d::Zero();
  std::vector<bool> inliers;  // parallel to the sights
  int inlier_count = 0;
};

// Tries `guess`, the first ray at the scene's depth, far away, and the midpoints of several pairs
// of rays; keeps the one that the sights agree with best (an earlier one if they do not care), then
// minimises the reprojection error over (u, v, rho) at the first agreeing camera. No value if
// fewer than two sights agree. `scene_depth` > 0: what is believed where the rays do not tell.
std::optional<TriangulatedPoint> TriangulateTrack(const TriangulationOptions& options,
                                                  const std::vector<TrackSight>& sights,
                                                  const std::optional<Eigen::Vector3d>& guess,
                                                  double scene_depth);

}  // namespace portolan

#endif  // PORTOLAN_COMMON_BUNDLE_TRIANGULATION_H_
