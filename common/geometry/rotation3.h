// Rotations of 3-space as unit quaternions (Hamilton), with the maps between the tangent space
// so(3) and the group (Sola et al., "A micro Lie theory", 2018, Sec. IV and App. B).
#ifndef PORTOLAN_COMMON_GEOMETRY_ROTATION3_H_
#define PORTOLAN_COMMON_GEOMETRY_ROTATION3_H_

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace portolan {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Vector7d = Eigen::Matrix<double, 7, 1>;
using Matrix23d = Eigen::Matrix<double, 2, 3>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Matrix7d = Eigen::Matrix<double, 7, 7>;

// [v]x, the matrix of the cross product: Skew(a) * b == a.cross(b).
Eigen::Matrix3d Skew(const Eigen::Vector3d& v);

// so(3) -> SO(3): rotation by |v| radians about v. Exact for small and large angles.
Eigen::Quaterniond RotationExp(const Eigen::Vector3d& v);

// SO(3) -> so(3), |result| <= pi.
Eigen::Vector3d RotationLog(const Eigen::Quaterniond& q);

// Right Jacobian of SO(3): Exp(v + d) ~= Exp(v) * Exp(Jr(v) * d), and its inverse.
Eigen::Matrix3d RotationRightJacobian(const Eigen::Vector3d& v);
Eigen::Matrix3d RotationRightJacobianInverse(const Eigen::Vector3d& v);

// The shortest rotation that turns the direction `from` into `to`; some half turn between opposite
// ones.
Eigen::Quaterniond RotationBetween(const Eigen::Vector3d& from, const Eigen::Vector3d& to);

// The rotation R that is nearest to m in the Frobenius norm, which has the largest tr(R' m)
// (Umeyama, "Least-squares estimation of transformation parameters", PAMI 1991, Eq. 40 and 43).
Eigen::Matrix2d NearestRotation(const Eigen::Matrix2d& m);
Eigen::Matrix3d NearestRotation(const Eigen::Matrix3d& m);

}  // namespace portolan

#endif  // PORTOLAN_COMMON_GEOMETRY_ROTATION3_H_
