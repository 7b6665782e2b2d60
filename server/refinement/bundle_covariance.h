// Marginal covariances of an adjusted bundle problem (dense in the cameras: for one submap or a
// window, not for a whole map).
#ifndef PORTOLAN_SERVER_REFINEMENT_BUNDLE_COVARIANCE_H_
#define PORTOLAN_SERVER_REFINEMENT_BUNDLE_COVARIANCE_H_

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "common/bundle/bundle_problem.h"

namespace portolan {

// Gauge: the fixed cameras are exact, and so is the norm of all free cameras' positions relative
// to the first camera (the scale), unless a fixed point or a distance prior holds the scale.
// Position priors do not enter; inverse depths get a prior as wide as the scene is deep, so that
// points without parallax have a large, finite variance along their rays.
// Immutable after creation.
class BundleCovariance {
 public:
  // No value if the system is singular (a free camera without enough observations).
  static std::optional<BundleCovariance> Compute(const BundleProblem& problem);

  // Of the right perturbation [translation; rotation]; zero for a fixed camera.
  Matrix6d Camera(int camera) const;
  // Of the point in the world; zero for a fixed point. The point has two inlier observations.
  Eigen::Matrix3d Point(int point) const;
  // Joint covariance of points (3 rows each, in this order) and then one camera (6 rows).
  Eigen::MatrixXd Joint(const std::vector<int>& points, int camera) const;
  // True if the point has the observations that Point() needs.
  bool HasPoint(int point) const { return !points_[point].rows.empty(); }

 private:
  // One camera's part of d(points)/d(cameras).
  struct Coupling {
    int row = 0;                          // of the camera's block in camera_covariance_
    Eigen::Matrix<double, 3, 6> weights;  // H_pp^-1 H_pc
  };
  struct PointBlock {
    std::vector<Coupling> rows;
    Eigen::Matrix3d conditional = Eigen::Matrix3d::Zero();  // H_pp^-1, in (u, v, rho)
    Eigen::Matrix3d d_point = Eigen::Matrix3d::Zero();      // d x / d (u, v, rho)
  };
  friend class BundleCovarianceBuilder;

  // Covariance of point i in (u, v, rho) with the cameras: 3 x all camera rows.
  Eigen::MatrixXd PointCameras(int point) const;

  std::vector<int> camera_rows_;  // -1: fixed
  Eigen::MatrixXd camera_covariance_;
  std::vector<PointBlock> points_;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_REFINEMENT_BUNDLE_COVARIANCE_H_
