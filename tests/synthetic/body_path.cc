#include "tests/synthetic/body_path.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "common/base/check.h"

namespace portolan::synthetic {
namespace {

using Eigen::Vector3d;
using Eigen::Vector4d;

// Weights of the four knots around a share s of an interval, and their derivatives by s.
struct BasisWeights {
  Vector4d value, first, second;
};

BasisWeights CubicBasis(double s) {
  const double r = 1 - s;
  BasisWeights weights;
  weights.value << r * r * r, 4 - 6 * s * s + 3 * s * s * s, 1 + 3 * s + 3 * s * s - 3 * s * s * s,
      s * s * s;
  weights.first << -3 * r * r, -12 * s + 9 * s * s, 3 + 6 * s - 9 * s * s, 3 * s * s;
  weights.second << 6 * r, -12 + 18 * s, 6 - 18 * s, 6 * s;
  weights.value /= 6;
  weights.first /= 6;
  weights.second /= 6;
  return weights;
}

// Body rates of Rz(yaw) Ry(pitch) Rx(roll) (Diebel, "Representing attitude", 2006, Eq. 79).
Vector3d BodyRates(const Vector3d& angles, const Vector3d& rates) {
  const double pitch = angles.y(), roll = angles.z();
  const double sin_roll = std::sin(roll), cos_roll = std::cos(roll);
  return {rates.z() - rates.x() * std::sin(pitch),
          rates.y() * cos_roll + rates.x() * std::cos(pitch) * sin_roll,
          -rates.y() * sin_roll + rates.x() * std::cos(pitch) * cos_roll};
}

}  // namespace

BodyPath::BodyPath(std::vector<PathKnot> knots, double interval_s)
    : knots_(std::move(knots)), interval_s_(interval_s) {
  PORTOLAN_CHECK(knots_.size() >= 4 && interval_s_ > 0);
}

double BodyPath::duration_s() const { return static_cast<double>(knots_.size() - 3) * interval_s_; }

BodyState BodyPath::At(double time_s) const {
  const double position = std::clamp(time_s, 0.0, duration_s()) / interval_s_;
  const size_t first = std::min(static_cast<size_t>(position), knots_.size() - 4);
  const BasisWeights weights = CubicBasis(position - static_cast<double>(first));
  BodyState state;
  Vector3d angles = Vector3d::Zero(), angle_rates = Vector3d::Zero();
  for (int i = 0; i < 4; ++i) {
    const PathKnot& knot = knots_[first + static_cast<size_t>(i)];
    state.world_from_body.translation += weights.value[i] * knot.position_m;
    state.velocity_in_world += weights.first[i] / interval_s_ * knot.position_m;
    state.acceleration_in_world +=
        weights.second[i] / (interval_s_ * interval_s_) * knot.position_m;
    angles += weights.value[i] * knot.yaw_pitch_roll_rad;
    angle_rates += weights.first[i] / interval_s_ * knot.yaw_pitch_roll_rad;
  }
  state.world_from_body.rotation = Eigen::AngleAxisd(angles.x(), Vector3d::UnitZ()) *
                                   Eigen::AngleAxisd(angles.y(), Vector3d::UnitY()) *
                                   Eigen::AngleAxisd(angles.z(), Vector3d::UnitX());
  state.angular_velocity_in_body = BodyRates(angles, angle_rates);
  return state;
}

}  // namespace portolan::synthetic
