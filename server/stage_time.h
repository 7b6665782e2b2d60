// How long the stages of the map builder take.
#ifndef PORTOLAN_SERVER_STAGE_TIME_H_
#define PORTOLAN_SERVER_STAGE_TIME_H_

#include <algorithm>
#include <chrono>
#include <cstdint>

namespace portolan {

// Wall time of one stage since the builder was created.
struct StageTime {
  int64_t count = 0;
  double last_ms = 0;
  double max_ms = 0;
  double total_ms = 0;

  void Add(double ms) {
    ++count;
    last_ms = ms;
    total_ms += ms;
    max_ms = std::max(max_ms, ms);
  }
};

struct StageTimes {
  StageTime refine;
  StageTime link;
  StageTime recognise;
  StageTime verify;
  StageTime align;
  StageTime fuse;
  StageTime background;
};

class StageClock {
 public:
  double ElapsedMs() const {
    return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start_)
        .count();
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

// Adds the time until its destruction to a stage.
class StageTimer {
 public:
  explicit StageTimer(StageTime* stage) : stage_(*stage) {}
  ~StageTimer() { stage_.Add(clock_.ElapsedMs()); }
  StageTimer(const StageTimer&) = delete;
  StageTimer& operator=(const StageTimer&) = delete;

 private:
  StageTime& stage_;
  StageClock clock_;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_STAGE_TIME_H_
