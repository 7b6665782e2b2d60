// Poses in whole steps, shared by the columns of poses and of frames: translations in units of a
// power of two, rotations as the rotation vector from the pose before (rad).
#ifndef PORTOLAN_COMMON_WIRE_POSE_STEPS_H_
#define PORTOLAN_COMMON_WIRE_POSE_STEPS_H_

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>

namespace portolan {

using Steps3 = std::array<int64_t, 3>;

// More is refused by the decoders: sums of this many stay exact in a double.
inline constexpr int64_t kMaxTranslationSteps = int64_t{1} << 40;
// The translation step is 2^e with e in this range.
inline constexpr int kMinTranslationExponent = -60, kMaxTranslationExponent = 60;

// The power of two that puts 2^bits to 2^(bits+1) steps into `largest` >= 0, a coordinate's
// magnitude; 2^-bits for zero.
double TranslationStep(double largest, int bits);

// To the nearest step.
Steps3 ToSteps(const Eigen::Vector3d& v, double step);
Eigen::Vector3d FromSteps(const Steps3& steps, double step);

// `turn`, as steps of `rotation_step` rad, that takes `from` to `to`: from * Exp(turn) ~ to.
Steps3 TurnBetween(const Eigen::Quaterniond& from, const Eigen::Quaterniond& to,
                   double rotation_step);
// from * Exp(turn). Encoder and decoder both walk through these rotations, so that rounding errors
// do not add up.
Eigen::Quaterniond Turned(const Eigen::Quaterniond& from, const Steps3& turn, double rotation_step);

}  // namespace portolan

#endif  // PORTOLAN_COMMON_WIRE_POSE_STEPS_H_
