// Residuals of a bundle adjustment with analytic Jacobians.
//
// A camera is a 6-vector [translation; rotation], the right perturbation of a constant reference
// pose:  R = R0 Exp(r),  t = t0 + R0 d.
// A point is (u, v, rho) about a constant anchor (the position of a camera that sees it, as it was
// before the solve): the ray  dir = bearing + u e1 + v e2  in the world's axes and the inverse
// distance rho along it, x = anchor + dir / rho (Civera, Davison, Montiel, T-RO 2008, with the
// anchor held constant, so that no second camera enters the residual). Points at infinity have
// rho = 0 and are as regular as any other.
#ifndef PORTOLAN_COMMON_BUNDLE_BUNDLE_TERMS_H_
#define PORTOLAN_COMMON_BUNDLE_BUNDLE_TERMS_H_

#include "common/bundle/bundle_problem.h"
#include "common/camera/camera_model.h"
#include "common/geometry/rigid3.h"

namespace portolan {

// The constant part of a camera block.
struct CameraReference {
  Rigid3 world_from_camera;
  const CameraModel* model = nullptr;

  Rigid3 Apply(const double* perturbation) const;
};

// A camera block's pose, and what its derivatives need, for all of its observations.
struct CameraState {
  const CameraReference* reference = nullptr;
  Eigen::Vector3d position_in_world = Eigen::Vector3d::Zero();
  Eigen::Matrix3d camera_from_world = Eigen::Matrix3d::Identity();
  // Of the camera's coordinates: by a move (in the reference's axes), by a turn.
  Eigen::Matrix3d camera_from_reference = Eigen::Matrix3d::Identity();
  Eigen::Matrix3d rotation_jacobian = Eigen::Matrix3d::Identity();

  CameraState() = default;
  CameraState(const CameraReference& camera, const double* perturbation);
  // At the reference.
  explicit CameraState(const CameraReference& camera);
};

// The constant part of a point block.
struct PointReference {
  Eigen::Vector3d anchor_in_world = Eigen::Vector3d::Zero();
  // Columns: e1, e2 (orthonormal tangents), bearing (unit).
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();

  // A reference whose parameters (0, 0, 1 / distance) give `point_in_world`.
  static PointReference At(const Eigen::Vector3d& anchor_in_world,
                           const Eigen::Vector3d& point_in_world);
  // The point; rho is raised to min_rho.
  Eigen::Vector3d Apply(const double* parameters, double min_rho) const;
  // Derivative of the point with respect to (u, v, rho).
  Eigen::Matrix3d PointJacobian(const double* parameters, double min_rho) const;
};

// (pixel - observed) / sigma. A point that does not project costs a constant: it neither steers
// the step nor fails the solve, and the outlier test removes the observation.
class ReprojectionError {
 public:
  // The reference is not owned and outlives this.
  ReprojectionError(const PointReference* point, const Eigen::Vector2d& pixel, double sigma_px)
      : point_(point), pixel_(pixel), inverse_sigma_(1.0 / sigma_px) {}

  // The residual (2) and, where not null, its row-major derivatives by camera (2 x 6) and point
  // (2 x 3).
  void Evaluate(const CameraState& camera, const double* point, double* residual, double* d_camera,
                double* d_point) const;

 private:
  const PointReference* point_;
  Eigen::Vector2d pixel_;
  double inverse_sigma_;
};

// (t - position) / (sigma * sigma_factors) and, where not null, its row-major derivative (3 x 6).
void EvaluatePositionPrior(const CameraReference& camera, const PositionPrior& prior,
                           const double* perturbation, double* residual, double* d_camera);

// log(|t_a - t_b| / distance) / sigma_log and, where not null, its derivatives (1 x 6 each).
void EvaluateDistancePrior(const CameraReference& camera_a, const CameraReference& camera_b,
                           double distance, double inverse_sigma, const double* perturbation_a,
                           const double* perturbation_b, double* residual, double* d_camera_a,
                           double* d_camera_b);

}  // namespace portolan

#endif  // PORTOLAN_COMMON_BUNDLE_BUNDLE_TERMS_H_
