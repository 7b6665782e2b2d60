// A bundle adjustment as plain data: cameras, points and pixels, in one frame ("world", which for
// a refinement is the submap's frame) and one length unit.
#ifndef PORTOLAN_COMMON_BUNDLE_BUNDLE_PROBLEM_H_
#define PORTOLAN_COMMON_BUNDLE_BUNDLE_PROBLEM_H_

#include <optional>
#include <vector>

#include "common/camera/camera_model.h"
#include "common/geometry/rigid3.h"

namespace portolan {

struct PositionPrior {
  Eigen::Vector3d position_in_world = Eigen::Vector3d::Zero();
  double sigma = 1.0;
  // Of each coordinate, times sigma.
  Eigen::Vector3d sigma_factors = Eigen::Vector3d::Ones();
};

struct BundleCamera {
  Rigid3 world_from_camera;
  const CameraModel* model = nullptr;  // not owned, not null
  bool fixed = false;
  // Where the camera is believed to be; for views whose parallax does not tell.
  std::optional<PositionPrior> prior;
};

struct BundlePoint {
  Eigen::Vector3d point_in_world = Eigen::Vector3d::Zero();
  bool fixed = false;
};

struct BundleObservation {
  int camera = 0;
  int point = 0;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double sigma_px = 1.0;
  // Only inliers enter a solve.
  bool inlier = true;
};

// The distance of two camera positions; holds (or measures) the scale. The residual is
// log(|t_a - t_b| / distance) / sigma_log.
struct DistancePrior {
  int camera_a = 0;
  int camera_b = 0;
  double distance = 1.0;
  double sigma_log = 1.0;
};

struct BundleProblem {
  std::vector<BundleCamera> cameras;
  std::vector<BundlePoint> points;
  std::vector<BundleObservation> observations;
  std::vector<DistancePrior> distances;
};

// Squared reprojection error in units of sigma_px^2; infinity if the point does not project.
double ReprojectionChi2(const BundleProblem& problem, const BundleObservation& observation);

// Largest angle between the rays from the inlier cameras to the point, in radians; the rays of
// the first camera against all others.
double ParallaxRad(const std::vector<Eigen::Vector3d>& camera_positions,
                   const Eigen::Vector3d& point_in_world);

// Scale of the scene: median distance of the points from the first camera that sees them. 1 if
// there is no observation.
double MedianDepth(const BundleProblem& problem);

}  // namespace portolan

#endif  // PORTOLAN_COMMON_BUNDLE_BUNDLE_PROBLEM_H_
