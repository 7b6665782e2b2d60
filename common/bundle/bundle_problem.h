// A bundle adjustment as plain data: cameras, points and pixels, in one frame ("world", which for
// a refinement is the submap's frame) and one length unit.
#ifndef PORTOLAN_COMMON_BUNDLE_BUNDLE_PROBLEM_H_
#define PORTOLAN_COMMON_BUNDLE_BUNDLE_PROBLEM_H_

#include <memory>
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

// What is unknown of a lens and its sensor: k1, k2 and the time between the first row and the last
// one [s].
using LensVector = Eigen::Vector3d;
using LensMatrix = Eigen::Matrix3d;

// Of a readout that is known: so firm that it does not move.
inline constexpr double kHeldReadoutSigma_s = 1e-6;

// A lens whose radial distortion is adjusted with the cameras that look through it: what a user's
// calibration, or none, leaves is often several pixels at the image's corners, and bends maps. So
// do images whose rows are read one after another while the camera moves.
struct BundleLens {
  // As it is now; BundleCamera::model of the cameras that look through it points here.
  std::shared_ptr<const CameraModel> model;
  // What it is less what is believed, and how far that is: the prior's residual is
  // sqrt_information * deviation.
  LensVector deviation = LensVector::Zero();
  LensMatrix sqrt_information = LensMatrix::Identity();
};

// A lens as it is now, whose calibration by the user is `nominal`; what that may be off moves a
// pixel at the image's corner by corner_sigma_px, by k1 and again by k2. readout_sigma_s: of the
// readout that the pixels are corrected for; the default holds it.
BundleLens MakeLens(std::shared_ptr<const CameraModel> now, const CameraModel& nominal,
                    double corner_sigma_px, double readout_sigma_s = kHeldReadoutSigma_s);

struct BundleCamera {
  Rigid3 world_from_camera;
  const CameraModel* model = nullptr;  // not owned, not null
  bool fixed = false;
  int lens = -1;  // index into BundleProblem::lenses; -1: `model` is held
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
  // By how much the pixel grows with the readout that it is corrected for, px/s.
  Eigen::Vector2d row_motion = Eigen::Vector2d::Zero();
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
  std::vector<BundleLens> lenses;
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
