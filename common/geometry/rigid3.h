// Rigid motions of 3-space, SE(3). Named a_from_b: maps coordinates in frame b to frame a.
#ifndef PORTOLAN_COMMON_GEOMETRY_RIGID3_H_
#define PORTOLAN_COMMON_GEOMETRY_RIGID3_H_

#include "common/geometry/rotation3.h"

namespace portolan {

// Tangent vectors are [translation; rotation] (6). Perturbations are on the right:
// T (+) d = T * Exp(d).
struct Rigid3 {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  static Rigid3 Identity() { return {}; }
  // se(3) -> SE(3) and back (Sola 2018, Eq. 172-174).
  static Rigid3 Exp(const Vector6d& tangent);
  Vector6d Log() const;

  Rigid3 Inverse() const;
  Eigen::Matrix4d Matrix() const;
  // Ad_T with T * Exp(d) == Exp(Ad_T * d) * T.
  Matrix6d Adjoint() const;

  friend Rigid3 operator*(const Rigid3& a_from_b, const Rigid3& b_from_c);
  friend Eigen::Vector3d operator*(const Rigid3& a_from_b, const Eigen::Vector3d& point_in_b) {
    return a_from_b.rotation * point_in_b + a_from_b.translation;
  }
};

}  // namespace portolan

#endif  // PORTOLAN_COMMON_GEOMETRY_RIGID3_H_
