// A bundle adjustment's unknowns, about the cameras and points from which a solve starts, as both
// of its solvers see them.
#ifndef PORTOLAN_COMMON_BUNDLE_BUNDLE_PARAMETERS_H_
#define PORTOLAN_COMMON_BUNDLE_BUNDLE_PARAMETERS_H_

#include <array>
#include <vector>

#include "common/bundle/bundle_options.h"
#include "common/bundle/bundle_terms.h"

namespace portolan {

struct BundleParameters {
  std::vector<CameraReference> camera_references;
  std::vector<std::array<double, 6>> cameras;
  // Cameras that see an adjusted point.
  std::vector<bool> cameras_used;
  std::vector<PointReference> point_references;
  std::vector<std::array<double, 3>> points;
  // Inlier observations of a point; points with fewer than two have no say unless they are held.
  std::vector<int> inliers;
  double median_depth = 1;
  // Added to each lens.
  std::vector<LensVector> lenses;

  // Anchors every point at the first camera that sees it.
  explicit BundleParameters(const BundleProblem& problem);

  bool HasSay(const BundleProblem& problem, const BundleObservation& observation) const {
    return observation.inlier &&
           (inliers[observation.point] >= 2 || problem.points[observation.point].fixed) &&
           !(problem.cameras[observation.camera].fixed && problem.points[observation.point].fixed);
  }
  bool IsAdjusted(const BundleProblem& problem, size_t point) const {
    return inliers[point] >= 2 && !problem.points[point].fixed;
  }
  // The prior of an adjusted point's inverse depth: sigma.
  double InverseDepthSigma(const BundleOptions& options, size_t point) const;
  // Writes what was adjusted. A lens that would no longer be invertible over the image stays.
  void WriteTo(const BundleOptions& options, BundleProblem* problem) const;
};

struct BundleSolve {
  bool usable = false;
  double initial_cost = 0;
  double final_cost = 0;
  int iterations = 0;
};

}  // namespace portolan

#endif  // PORTOLAN_COMMON_BUNDLE_BUNDLE_PARAMETERS_H_
