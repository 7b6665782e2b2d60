#include "common/wire/pose_columns.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "absl/strings/str_cat.h"
#include "common/wire/column_codec.h"
#include "common/wire/geometry_wire.h"
#include "common/wire/pose_steps.h"

namespace portolan {
namespace {

constexpr double kRotationStep_rad = 1.0 / (1 << 15);
// More than pi in rotation steps.
constexpr int64_t kMaxRotationSteps = int64_t{4} << 15;

// 2^14 to 2^15 steps in the largest coordinate.
double StepOf(const std::vector<Rigid3>& poses) {
  double largest = 0;
  for (const Rigid3& pose : poses) {
    largest = std::max(largest, pose.translation.cwiseAbs().maxCoeff());
  }
  return TranslationStep(largest, 14);
}

Status Malformed(absl::string_view what, absl::string_view why) {
  return absl::InvalidArgumentError(absl::StrCat(what, ": ", why));
}

bool IsWithin(const Steps3& steps, int64_t limit) {
  return std::all_of(steps.begin(), steps.end(),
                     [limit](int64_t s) { return s <= limit && s >= -limit; });
}

}  // namespace

void EncodePoses(const std::vector<Rigid3>& poses, v1::PoseColumns* columns) {
  const double step = StepOf(poses);
  std::vector<int64_t> translations, rotations;
  Steps3 last_translation{};
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  for (const Rigid3& pose : poses) {
    const Steps3 translation = ToSteps(pose.translation, step);
    const Steps3 turn = TurnBetween(rotation, pose.rotation, kRotationStep_rad);
    for (size_t axis = 0; axis < 3; ++axis) {
      translations.push_back(translation[axis] - last_translation[axis]);
      rotations.push_back(turn[axis]);
    }
    last_translation = translation;
    rotation = Turned(rotation, turn, kRotationStep_rad);
  }
  columns->set_count(static_cast<uint32_t>(poses.size()));
  columns->set_translation_step(step);
  columns->set_translation(EncodeColumn(translations));
  columns->set_rotation(EncodeColumn(rotations));
}

StatusOr<std::vector<Rigid3>> DecodePoses(const v1::PoseColumns& columns, size_t max_poses,
                                          absl::string_view what) {
  if (columns.count() > max_poses) return Malformed(what, "too many poses");
  const double step = columns.translation_step();
  // Written so that NaN fails.
  if (!(step >= std::ldexp(1.0, kMinTranslationExponent) &&
        step <= std::ldexp(1.0, kMaxTranslationExponent))) {
    return Malformed(what, "translation_step out of range");
  }
  const auto translations = DecodeColumn(columns.translation(), 3 * columns.count());
  if (!translations.ok()) return Malformed(what, translations.status().message());
  const auto rotations = DecodeColumn(columns.rotation(), 3 * columns.count());
  if (!rotations.ok()) return Malformed(what, rotations.status().message());
  std::vector<Rigid3> poses;
  Steps3 translation{};
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  for (size_t i = 0; i < columns.count(); ++i) {
    const int64_t* moved = translations->data() + 3 * i;
    const int64_t* turned = rotations->data() + 3 * i;
    const Steps3 move = {moved[0], moved[1], moved[2]};
    const Steps3 turn = {turned[0], turned[1], turned[2]};
    if (!IsWithin(move, kMaxTranslationSteps) || !IsWithin(turn, kMaxRotationSteps)) {
      return Malformed(what, "step out of range");
    }
    for (size_t axis = 0; axis < 3; ++axis) translation[axis] += move[axis];
    rotation = Turned(rotation, turn, kRotationStep_rad);
    poses.push_back({rotation, FromSteps(translation, step)});
    PORTOLAN_RETURN_IF_ERROR(CheckPose(poses.back(), what));
  }
  return poses;
}

}  // namespace portolan
