#include "common/wire/pose_steps.h"

#include <algorithm>
#include <cmath>

#include "common/geometry/rotation3.h"

namespace portolan {

double TranslationStep(double largest, int bits) {
  const int exponent = largest > 0 ? std::ilogb(largest) - bits : -bits;
  return std::ldexp(1.0, std::clamp(exponent, kMinTranslationExponent, kMaxTranslationExponent));
}

Steps3 ToSteps(const Eigen::Vector3d& v, double step) {
  return {std::llround(v.x() / step), std::llround(v.y() / step), std::llround(v.z() / step)};
}

Eigen::Vector3d FromSteps(const Steps3& steps, double step) {
  return Eigen::Vector3d(static_cast<double>(steps[0]), static_cast<double>(steps[1]),
                         static_cast<double>(steps[2])) *
         step;
}

Steps3 TurnBetween(const Eigen::Quaterniond& from, const Eigen::Quaterniond& to,
                   double rotation_step) {
  return ToSteps(RotationLog((from.conjugate() * to).normalized()), rotation_step);
}

Eigen::Quaterniond Turned(const Eigen::Quaterniond& from, const Steps3& turn,
                          double rotation_step) {
  return (from * RotationExp(FromSteps(turn, rotation_step))).normalized();
}

}  // namespace portolan
