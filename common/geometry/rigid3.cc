#include "common/geometry/rigid3.h"

namespace portolan {

Rigid3 Rigid3::Exp(const Vector6d& tangent) {
  const Eigen::Vector3d angle = tangent.tail<3>();
  // The left Jacobian of v is the right Jacobian of -v.
  return {RotationExp(angle), RotationRightJacobian(-angle) * tangent.head<3>()};
}

Vector6d Rigid3::Log() const {
  const Eigen::Vector3d angle = RotationLog(rotation);
  Vector6d tangent;
  tangent << RotationRightJacobianInverse(-angle) * translation, angle;
  return tangent;
}

Rigid3 Rigid3::Inverse() const {
  const Eigen::Quaterniond inverse = rotation.conjugate();
  return {inverse, -(inverse * translation)};
}

Eigen::Matrix4d Rigid3::Matrix() const {
  Eigen::Matrix4d matrix = Eigen::Matrix4d::Identity();
  matrix.topLeftCorner<3, 3>() = rotation.toRotationMatrix();
  matrix.topRightCorner<3, 1>() = translation;
  return matrix;
}

Matrix6d Rigid3::Adjoint() const {
  const Eigen::Matrix3d r = rotation.toRotationMatrix();
  Matrix6d adjoint;
  adjoint << r, Skew(translation) * r, Eigen::Matrix3d::Zero(), r;
  return adjoint;
}

Rigid3 operator*(const Rigid3& a_from_b, const Rigid3& b_from_c) {
  return {(a_from_b.rotation * b_from_c.rotation).normalized(), a_from_b * b_from_c.translation};
}

}  // namespace portolan
