#include "common/bundle/bundle_terms.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace portolan {
namespace {

using Vector3Map = Eigen::Map<const Eigen::Vector3d>;

// Residual, in sigmas, of an observation whose point does not project.
constexpr double kUnprojectableResidual = 20.0;
// Below this distance (in the problem's unit) the direction between two cameras is undefined.
constexpr double kMinDistance = 1e-12;

}  // namespace

Rigid3 CameraReference::Apply(const double* perturbation) const {
  return {(world_from_camera.rotation * RotationExp(Vector3Map(perturbation + 3))).normalized(),
          world_from_camera.translation + world_from_camera.rotation * Vector3Map(perturbation)};
}

CameraState::CameraState(const CameraReference& camera, const double* perturbation)
    : reference(&camera) {
  const Rigid3 pose = camera.Apply(perturbation);
  position_in_world = pose.translation;
  camera_from_world = pose.rotation.conjugate().toRotationMatrix();
  camera_from_reference = camera_from_world * camera.world_from_camera.rotation.toRotationMatrix();
  rotation_jacobian = RotationRightJacobian(Vector3Map(perturbation + 3));
}

CameraState::CameraState(const CameraReference& camera)
    : CameraState(camera, std::array<double, 6>{}.data()) {}

PointReference PointReference::At(const Eigen::Vector3d& anchor_in_world,
                                  const Eigen::Vector3d& point_in_world) {
  PointReference reference;
  reference.anchor_in_world = anchor_in_world;
  const Eigen::Vector3d bearing = (point_in_world - anchor_in_world).normalized();
  reference.axes.col(0) = bearing.unitOrthogonal();
  reference.axes.col(1) = bearing.cross(reference.axes.col(0));
  reference.axes.col(2) = bearing;
  return reference;
}

Eigen::Vector3d PointReference::Apply(const double* parameters, double min_rho) const {
  const Eigen::Vector3d direction = axes * Eigen::Vector3d(parameters[0], parameters[1], 1.0);
  return anchor_in_world + direction / std::max(parameters[2], min_rho);
}

Eigen::Matrix3d PointReference::PointJacobian(const double* parameters, double min_rho) const {
  const double rho = std::max(parameters[2], min_rho);
  const Eigen::Vector3d direction = axes * Eigen::Vector3d(parameters[0], parameters[1], 1.0);
  Eigen::Matrix3d jacobian;
  jacobian.leftCols<2>() = axes.leftCols<2>() / rho;
  jacobian.col(2) = -direction / (rho * rho);
  return jacobian;
}

void ReprojectionError::Evaluate(const CameraState& camera, const double* point, double* residual,
                                 double* d_camera, double* d_point) const {
  const double rho = point[2];
  const Eigen::Vector3d direction = point_->axes * Eigen::Vector3d(point[0], point[1], 1.0);
  const Eigen::Vector3d anchor_from_camera = point_->anchor_in_world - camera.position_in_world;
  // The point in the camera, up to the positive factor rho, which no pixel depends on.
  const Eigen::Vector3d scaled_point =
      camera.camera_from_world * (direction + rho * anchor_from_camera);

  const bool is_derived = d_camera != nullptr || d_point != nullptr;
  Eigen::Map<Eigen::Vector2d> error(residual);
  Matrix23d d_pixel_d_point = Matrix23d::Zero();
  const std::optional<Eigen::Vector2d> pixel =
      camera.reference->model->Project(scaled_point, is_derived ? &d_pixel_d_point : nullptr);
  if (pixel) {
    error = (*pixel - pixel_) * inverse_sigma_;
    d_pixel_d_point *= inverse_sigma_;
  } else {
    error.setConstant(kUnprojectableResidual);
    d_pixel_d_point.setZero();
  }
  if (d_camera != nullptr) {
    Eigen::Map<Eigen::Matrix<double, 2, 6, Eigen::RowMajor>> map(d_camera);
    map.leftCols<3>().noalias() = -rho * d_pixel_d_point * camera.camera_from_reference;
    const Matrix23d turned = d_pixel_d_point * Skew(scaled_point);
    map.rightCols<3>().noalias() = turned * camera.rotation_jacobian;
  }
  if (d_point != nullptr) {
    Eigen::Map<Eigen::Matrix<double, 2, 3, Eigen::RowMajor>> map(d_point);
    const Matrix23d d_pixel_d_world = d_pixel_d_point * camera.camera_from_world;
    map.leftCols<2>().noalias() = d_pixel_d_world * point_->axes.leftCols<2>();
    map.col(2).noalias() = d_pixel_d_world * anchor_from_camera;
  }
}

void EvaluatePositionPrior(const CameraReference& camera, const PositionPrior& prior,
                           const double* perturbation, double* residual, double* d_camera) {
  const Rigid3& reference = camera.world_from_camera;
  Eigen::Map<Eigen::Vector3d> error(residual);
  const Eigen::Vector3d sigmas = prior.sigma * prior.sigma_factors;
  error = (reference.translation + reference.rotation * Vector3Map(perturbation) -
           prior.position_in_world)
              .cwiseQuotient(sigmas);
  if (d_camera == nullptr) return;
  Eigen::Map<Eigen::Matrix<double, 3, 6, Eigen::RowMajor>> map(d_camera);
  map.setZero();
  const Eigen::Matrix3d rotation = reference.rotation.toRotationMatrix();
  for (int i = 0; i < 3; ++i) map.row(i).leftCols<3>() = rotation.row(i) / sigmas[i];
}

void EvaluateDistancePrior(const CameraReference& camera_a, const CameraReference& camera_b,
                           double distance, double inverse_sigma, const double* perturbation_a,
                           const double* perturbation_b, double* residual, double* d_camera_a,
                           double* d_camera_b) {
  const Rigid3& a = camera_a.world_from_camera;
  const Rigid3& b = camera_b.world_from_camera;
  const Eigen::Vector3d difference = a.translation + a.rotation * Vector3Map(perturbation_a) -
                                     b.translation - b.rotation * Vector3Map(perturbation_b);
  const double norm = std::max(difference.norm(), kMinDistance);
  *residual = std::log(norm / distance) * inverse_sigma;
  // d log|x| = x' dx / |x|^2.
  const Eigen::RowVector3d d_difference = difference.transpose() / (norm * norm) * inverse_sigma;
  if (d_camera_a != nullptr) {
    Eigen::Map<Eigen::Matrix<double, 1, 6>> map(d_camera_a);
    map.setZero();
    map.leftCols<3>() = d_difference * a.rotation.toRotationMatrix();
  }
  if (d_camera_b != nullptr) {
    Eigen::Map<Eigen::Matrix<double, 1, 6>> map(d_camera_b);
    map.setZero();
    map.leftCols<3>() = -d_difference * b.rotation.toRotationMatrix();
  }
}

}  // namespace portolan
