// Keeps the times of a source's frames strictly ascending.
#ifndef PORTOLAN_AGENT_IMAGE_SOURCE_TIME_ORDER_H_
#define PORTOLAN_AGENT_IMAGE_SOURCE_TIME_ORDER_H_

#include <cstdint>
#include <optional>
#include <string>

#include "common/base/status.h"
#include "common/base/time.h"

namespace portolan {

// Thread-compatible.
class TimeOrder {
 public:
  explicit TimeOrder(int max_in_row) : max_in_row_(max_in_row) {}

  // Whether the frame may be used; otherwise it is counted and the first ones are logged. A frame
  // whose successor (if `next` is known) lies between the last one used and itself has a wrong time
  // and is left out, since all that follow would be. FailedPrecondition when more frames in a row
  // are left out than allowed: the clock was set back for good.
  StatusOr<bool> Take(Timestamp time, std::optional<Timestamp> next, const std::string& name);

  int64_t skipped() const { return skipped_; }

 private:
  // Why the frame cannot be used; empty if it can.
  std::string Objection(Timestamp time, std::optional<Timestamp> next) const;

  const int max_in_row_;
  std::optional<Timestamp> last_;
  std::string last_name_;
  int64_t skipped_ = 0;
  int in_row_ = 0;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_IMAGE_SOURCE_TIME_ORDER_H_
