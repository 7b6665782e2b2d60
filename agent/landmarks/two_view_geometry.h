// Relative pose of two views from matched bearings alone.
#ifndef PORTOLAN_AGENT_LANDMARKS_TWO_VIEW_GEOMETRY_H_
#define PORTOLAN_AGENT_LANDMARKS_TWO_VIEW_GEOMETRY_H_

#include <Eigen/Core>
#include <optional>
#include <span>

#include "common/geometry/rigid3.h"

namespace portolan {

struct BearingPair {
  Eigen::Vector3d in_first = Eigen::Vector3d::UnitZ();
  Eigen::Vector3d in_second = Eigen::Vector3d::UnitZ();
};

// Volume of the two bearings and the translation, b2 . (t x R b1), zero for a match (the epipolar
// constraint), with derivatives by a right perturbation of the rotation and by the translation.
struct EpipolarResidual {
  double value = 0;
  Eigen::RowVector3d d_rotation, d_translation;
  // Sine of the angle between R b1 and t: value over it is that between b2 and the epipolar plane.
  double sine = 0;
};
EpipolarResidual EpipolarResidualOf(const Rigid3& second_from_first, const BearingPair& pair);

// Essential matrix by five points and RANSAC (Nister, PAMI 2004, in OpenCV), decomposed by
// cheirality, then Gauss-Newton over the pairs that support it. The translation of
// second_from_first has length one. Pairs within sigma_rad * 3 of their epipolar line support it;
// bearings 80 degrees or more off the axis are left out. No value with fewer than ten pairs, or if
// fewer than half of them support the pose. Deterministic.
std::optional<Rigid3> PoseOfTwoViews(std::span<const BearingPair> pairs, double sigma_rad);

}  // namespace portolan

#endif  // PORTOLAN_AGENT_LANDMARKS_TWO_VIEW_GEOMETRY_H_
