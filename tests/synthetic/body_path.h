// A smooth path of a body in time with exact derivatives: uniform cubic B-splines (de Boor, "A
// practical guide to splines", 1978) of the position and of yaw, pitch and roll.
#ifndef PORTOLAN_TESTS_SYNTHETIC_BODY_PATH_H_
#define PORTOLAN_TESTS_SYNTHETIC_BODY_PATH_H_

#include <Eigen/Core>
#include <vector>

#include "common/geometry/rigid3.h"

namespace portolan::synthetic {

// World: z up. Body: x forward, y left, z up. SI units.
struct BodyState {
  Rigid3 world_from_body;
  Eigen::Vector3d velocity_in_world = Eigen::Vector3d::Zero();
  Eigen::Vector3d acceleration_in_world = Eigen::Vector3d::Zero();
  Eigen::Vector3d angular_velocity_in_body = Eigen::Vector3d::Zero();
};

// One control point of the path; the spline passes near it.
struct PathKnot {
  Eigen::Vector3d position_m = Eigen::Vector3d::Zero();
  // world_from_body = Rz(yaw) Ry(pitch) Rx(roll); yaw must not jump by 2 pi between knots.
  Eigen::Vector3d yaw_pitch_roll_rad = Eigen::Vector3d::Zero();
};

// Immutable, thread-safe.
class BodyPath {
 public:
  // Knots every interval_s; at least 4. Knot i + 1 belongs to time i * interval_s, so the path
  // spans (knots - 3) intervals from time 0.
  BodyPath(std::vector<PathKnot> knots, double interval_s);

  double duration_s() const;
  // Times outside of the span are taken as its ends.
  BodyState At(double time_s) const;

 private:
  std::vector<PathKnot> knots_;
  double interval_s_;
};

}  // namespace portolan::synthetic

#endif  // PORTOLAN_TESTS_SYNTHETIC_BODY_PATH_H_
