#include "agent/image_source/time_order.h"

#include "common/base/concat.h"
#include "common/base/logging.h"

namespace portolan {
namespace {

// After so many warnings only the counts go on.
constexpr int64_t kMaxOrderWarnings = 5;
// What the wire takes (proto/submap.proto): 73 years since the clock's epoch.
constexpr Timestamp kLastTime{(int64_t{1} << 61) - 1};

}  // namespace

std::string TimeOrder::Objection(Timestamp time, std::optional<Timestamp> next) const {
  if (time < Timestamp::zero() || time > kLastTime) {
    return Concat("its time ", time.count(), " ns is not that of a clock");
  }
  if (last_ && time <= *last_) {
    return Concat("its time ", time.count(), " ns is not after ", last_->count(), " ns of ",
                  last_name_);
  }
  if (last_ && next && *next > *last_ && *next < time) {
    return Concat("its time ", time.count(), " ns is after ", next->count(),
                  " ns of the frame that follows");
  }
  return {};
}

StatusOr<bool> TimeOrder::Take(Timestamp time, std::optional<Timestamp> next,
                               const std::string& name) {
  const std::string objection = Objection(time, next);
  if (objection.empty()) {
    last_ = time;
    last_name_ = name;
    in_row_ = 0;
    return true;
  }
  if (++skipped_ <= kMaxOrderWarnings) LogWarning(name, ": ", objection, "; skipped");
  if (++in_row_ <= max_in_row_) return false;
  return absl::FailedPreconditionError(Concat(
      name, ": ", objection, ", nor were those of the ", max_in_row_,
      " frames before it: the clock has gone back, or the time of ", last_name_, " was wrong"));
}

}  // namespace portolan
