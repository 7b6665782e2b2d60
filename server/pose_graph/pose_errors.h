// The error functions of pose graph edges, for plain numbers and for automatic differentiation.
#ifndef PORTOLAN_SERVER_POSE_GRAPH_POSE_ERRORS_H_
#define PORTOLAN_SERVER_POSE_GRAPH_POSE_ERRORS_H_

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>

#include "server/pose_graph/pose_graph.h"

namespace portolan {

// Poses as [qx qy qz qw tx ty tz].
template <typename T>
Eigen::Matrix<T, 6, 1> PoseError3(const PoseEdge3& edge, const T* world_from_a,
                                  const T* world_from_b) {
  const Eigen::Map<const Eigen::Quaternion<T>> q_a(world_from_a), q_b(world_from_b);
  const Eigen::Map<const Eigen::Matrix<T, 3, 1>> t_a(world_from_a + 4), t_b(world_from_b + 4);
  const Eigen::Quaternion<T> measured = edge.a_from_b.rotation.conjugate().template cast<T>();
  Eigen::Quaternion<T> rotation = measured * q_a.conjugate() * q_b;
  if (rotation.w() < T(0)) rotation.coeffs() = -rotation.coeffs();
  Eigen::Matrix<T, 6, 1> error;
  error.template head<3>() =
      measured * (q_a.conjugate() * (t_b - t_a) - edge.a_from_b.translation.template cast<T>());
  error.template tail<3>() = rotation.vec();
  return error;
}

// Poses as [x y heading].
template <typename T>
Eigen::Matrix<T, 3, 1> PoseError2(const PoseEdge2& edge, const T* a, const T* b) {
  using std::atan2;
  using std::cos;
  using std::sin;
  const T dx = b[0] - a[0], dy = b[1] - a[1];
  const T cos_a = cos(a[2]), sin_a = sin(a[2]);
  const T x = cos_a * dx + sin_a * dy - T(edge.a_from_b[0]);
  const T y = -sin_a * dx + cos_a * dy - T(edge.a_from_b[1]);
  const double cos_m = std::cos(edge.a_from_b[2]), sin_m = std::sin(edge.a_from_b[2]);
  const T heading = b[2] - a[2] - T(edge.a_from_b[2]);
  return {cos_m * x + sin_m * y, -sin_m * x + cos_m * y, atan2(sin(heading), cos(heading))};
}

}  // namespace portolan

#endif  // PORTOLAN_SERVER_POSE_GRAPH_POSE_ERRORS_H_
