// The depth of a point from rays of known cameras.
#ifndef PORTOLAN_AGENT_LANDMARKS_TRIANGULATION_H_
#define PORTOLAN_AGENT_LANDMARKS_TRIANGULATION_H_

#include <Eigen/Core>
#include <optional>
#include <span>

#include "common/geometry/rigid3.h"

namespace portolan {

// A unit bearing in a camera, and the camera from the one that the depth is wanted in (the
// reference).
struct BearingView {
  Rigid3 camera_from_reference;
  Eigen::Vector3d bearing = Eigen::Vector3d::UnitZ();
};

// The point in the reference camera is (ray + tangents * (u, v)) / inverse_depth: (u, v, inverse
// depth) is what is estimated, finite for points at infinity.
struct InverseDepthPoint {
  Eigen::Vector3d ray = Eigen::Vector3d::UnitZ();  // unit: the reference's own bearing
  Eigen::Matrix<double, 3, 2> tangents;
  Eigen::Vector3d value = Eigen::Vector3d::Zero();

  // Direction of the point in the reference camera, and the point times its inverse depth.
  Eigen::Vector3d Direction() const { return ray + tangents * value.head<2>(); }
};
// With tangents at right angles to the ray, and (u, v) zero.
InverseDepthPoint MakeInverseDepthPoint(const Eigen::Vector3d& ray, double inverse_depth);

// The point's unit direction in the view across the view's bearing: two sines of the angle between
// them, with derivatives by (u, v, inverse depth).
struct BearingResidual {
  Eigen::Vector2d value;
  Eigen::Matrix<double, 2, 3> d_point;
};
// No value if the direction is 90 degrees or more off the bearing.
std::optional<BearingResidual> ResidualOf(const BearingView& view, const InverseDepthPoint& point);

// Linear triangulation (DLT: Hartley & Zisserman, 2nd ed., Sec. 12.2, with bearings in place of
// pixels): the homogeneous point whose cross products with the rotated bearings are least. `other`
// is the second view; the first is the reference itself. Returns the inverse distance along the
// reference's bearing; no value if the point is behind either camera or at infinity.
std::optional<double> InverseDepthByDlt(const Eigen::Vector3d& bearing_in_reference,
                                        const BearingView& other);

struct DepthEstimate {
  double inverse_depth = 0;
  double sigma = 0;
};

// Of a point that was seen by the reference and these views: the Gauss-Newton covariance of
// (u, v, inverse depth) for bearings with the given error a view. No value if undetermined.
std::optional<double> InverseDepthSigma(const InverseDepthPoint& point,
                                        std::span<const BearingView> views, double sigma_rad);

// Levenberg-Marquardt over all views and the reference's own bearing from a start; no value if the
// start or the result is not before all cameras.
std::optional<DepthEstimate> InverseDepthByLevenbergMarquardt(
    const Eigen::Vector3d& bearing_in_reference, double start_inverse_depth,
    std::span<const BearingView> views, double sigma_rad);

}  // namespace portolan

#endif  // PORTOLAN_AGENT_LANDMARKS_TRIANGULATION_H_
