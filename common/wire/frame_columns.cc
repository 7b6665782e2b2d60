#include <algorithm>
#include <array>
#include <optional>

#include "absl/strings/str_cat.h"
#include "common/wire/column_codec.h"
#include "common/wire/geometry_wire.h"
#include "common/wire/pose_steps.h"
#include "common/wire/submap_columns.h"
#include "common/wire/submap_validation.h"

namespace portolan {
namespace {

constexpr double kRotationStep_rad = 1.0 / (1 << 20);
// More than pi in rotation steps.
constexpr int64_t kMaxRotationSteps = int64_t{4} << 20;

// 2^20 to 2^21 steps in the largest coordinate.
double StepOf(const std::vector<FramePose>& frames) {
  double largest = 0;
  for (const FramePose& frame : frames) {
    largest = std::max(largest, frame.submap_from_camera.translation.cwiseAbs().maxCoeff());
  }
  return TranslationStep(largest, 20);
}

// Second differences of a series whose first two predecessors are equal to `origin`.
class SecondDifference {
 public:
  explicit SecondDifference(int64_t origin) : last_(origin), before_(origin) {}

  int64_t Encode(int64_t value) {
    const int64_t difference = value - 2 * last_ + before_;
    Push(value);
    return difference;
  }
  // No value if the result's magnitude exceeds `limit`, which must be below 2^61.
  std::optional<int64_t> Decode(int64_t difference, int64_t limit) {
    const auto value = AddWithin(2 * last_ - before_, difference, limit);
    if (value.has_value()) Push(*value);
    return value;
  }

 private:
  void Push(int64_t value) {
    before_ = last_;
    last_ = value;
  }
  int64_t last_;
  int64_t before_;
};

struct Columns {
  std::vector<int64_t> time;
  std::array<std::vector<int64_t>, 3> translation, rotation;
};

Columns EncodeColumns(const std::vector<FramePose>& frames, double translation_step) {
  Columns c;
  SecondDifference time(frames.front().time.count());
  std::array<SecondDifference, 3> translation{SecondDifference(0), SecondDifference(0),
                                              SecondDifference(0)};
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Steps3 turn{};
  for (const FramePose& frame : frames) {
    c.time.push_back(time.Encode(frame.time.count()));
    const Steps3 t = ToSteps(frame.submap_from_camera.translation, translation_step);
    const Steps3 r = TurnBetween(rotation, frame.submap_from_camera.rotation, kRotationStep_rad);
    for (size_t axis = 0; axis < 3; ++axis) {
      c.translation[axis].push_back(translation[axis].Encode(t[axis]));
      c.rotation[axis].push_back(r[axis] - turn[axis]);
    }
    turn = r;
    rotation = Turned(rotation, turn, kRotationStep_rad);
  }
  return c;
}

StatusOr<Columns> DecodeColumns(const v1::FrameColumns& m) {
  const size_t f = m.count();
  Columns c;
  PORTOLAN_ASSIGN_OR_RETURN(c.time, NamedColumn(m.time_ns(), f, "submap.frames.time_ns"));
  const std::array<const std::string*, 3> translation = {&m.translation_x(), &m.translation_y(),
                                                         &m.translation_z()};
  const std::array<const std::string*, 3> rotation = {&m.rotation_x(), &m.rotation_y(),
                                                      &m.rotation_z()};
  for (size_t axis = 0; axis < 3; ++axis) {
    PORTOLAN_ASSIGN_OR_RETURN(c.translation[axis],
                              NamedColumn(*translation[axis], f, "submap.frames.translation"));
    PORTOLAN_ASSIGN_OR_RETURN(c.rotation[axis],
                              NamedColumn(*rotation[axis], f, "submap.frames.rotation"));
  }
  return c;
}

Status OutOfRange(size_t frame, absl::string_view what) {
  return absl::InvalidArgumentError(
      absl::StrCat("submap.frames[", frame, "].", what, ": out of range"));
}

Status CheckHeader(const v1::FrameColumns& columns) {
  if (columns.count() > kMaxFrames) {
    return absl::InvalidArgumentError(absl::StrCat("submap.frames: more than ", kMaxFrames));
  }
  if (columns.time_origin_ns() < 0 || columns.time_origin_ns() > kMaxTime.count()) {
    return absl::InvalidArgumentError("submap.frames.time_origin_ns: out of range");
  }
  if (!(columns.translation_step() > 0 && columns.translation_step() <= kMaxCoordinate)) {
    return absl::InvalidArgumentError("submap.frames.translation_step: not positive and finite");
  }
  return absl::OkStatus();
}

}  // namespace

void EncodeFrames(const std::vector<FramePose>& frames, v1::FrameColumns* columns) {
  if (frames.empty()) return;
  columns->set_count(static_cast<uint32_t>(frames.size()));
  columns->set_time_origin_ns(frames.front().time.count());
  columns->set_translation_step(StepOf(frames));
  const Columns c = EncodeColumns(frames, columns->translation_step());
  columns->set_time_ns(EncodeColumn(c.time));
  columns->set_translation_x(EncodeColumn(c.translation[0]));
  columns->set_translation_y(EncodeColumn(c.translation[1]));
  columns->set_translation_z(EncodeColumn(c.translation[2]));
  columns->set_rotation_x(EncodeColumn(c.rotation[0]));
  columns->set_rotation_y(EncodeColumn(c.rotation[1]));
  columns->set_rotation_z(EncodeColumn(c.rotation[2]));
}

StatusOr<std::vector<FramePose>> DecodeFrames(const v1::FrameColumns& columns) {
  if (columns.count() == 0) return std::vector<FramePose>();
  PORTOLAN_RETURN_IF_ERROR(CheckHeader(columns));
  PORTOLAN_ASSIGN_OR_RETURN(const Columns c, DecodeColumns(columns));
  std::vector<FramePose> frames(columns.count());
  SecondDifference time(columns.time_origin_ns());
  std::array<SecondDifference, 3> translation{SecondDifference(0), SecondDifference(0),
                                              SecondDifference(0)};
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Steps3 turn{};
  for (size_t i = 0; i < frames.size(); ++i) {
    const auto t = time.Decode(c.time[i], kMaxTime.count());
    if (!t.has_value()) return OutOfRange(i, "time");
    frames[i].time = Timestamp(*t);
    Steps3 position;
    for (size_t axis = 0; axis < 3; ++axis) {
      const auto p = translation[axis].Decode(c.translation[axis][i], kMaxTranslationSteps);
      const auto r = AddWithin(turn[axis], c.rotation[axis][i], kMaxRotationSteps);
      if (!p.has_value() || !r.has_value()) return OutOfRange(i, "submap_from_camera");
      position[axis] = *p;
      turn[axis] = *r;
    }
    rotation = Turned(rotation, turn, kRotationStep_rad);
    frames[i].submap_from_camera = {rotation, FromSteps(position, columns.translation_step())};
  }
  return frames;
}

}  // namespace portolan
