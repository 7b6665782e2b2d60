// Similarities of 3-space, Sim(3): x_a = scale * (rotation * x_b) + translation.
#ifndef PORTOLAN_COMMON_GEOMETRY_SIMILARITY3_H_
#define PORTOLAN_COMMON_GEOMETRY_SIMILARITY3_H_

#include "common/geometry/rigid3.h"

namespace portolan {

// Tangent vectors are [translation; rotation; log scale] (7). Perturbations are on the right:
// S (+) d = S * Exp(d).
struct Similarity3 {
  double scale = 1.0;
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  static Similarity3 Identity() { return {}; }
  static Similarity3 FromRigid(const Rigid3& rigid, double scale = 1.0);
  // sim(3) -> Sim(3) and back (Strasdat, PhD thesis 2012, Sec. 2.4).
  static Similarity3 Exp(const Vector7d& tangent);
  Vector7d Log() const;

  Similarity3 Inverse() const;
  // The rigid motion that places a camera or body: rotation and translation, scale dropped.
  Rigid3 Rigid() const { return {rotation, translation}; }
  Matrix7d Adjoint() const;

  friend Similarity3 operator*(const Similarity3& a_from_b, const Similarity3& b_from_c);
  friend Eigen::Vector3d operator*(const Similarity3& a_from_b, const Eigen::Vector3d& point_in_b) {
    return a_from_b.scale * (a_from_b.rotation * point_in_b) + a_from_b.translation;
  }
  // Places a rigid frame c, known in b's units, in a: rotation composed, translation mapped.
  // The result's lengths are a's units.
  friend Rigid3 operator*(const Similarity3& a_from_b, const Rigid3& b_from_c);
};

}  // namespace portolan

#endif  // PORTOLAN_COMMON_GEOMETRY_SIMILARITY3_H_
