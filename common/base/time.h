// Sensor time: nanoseconds since the data set's or the system's epoch.
#ifndef PORTOLAN_COMMON_BASE_TIME_H_
#define PORTOLAN_COMMON_BASE_TIME_H_

#include <chrono>
#include <cmath>
#include <cstdint>

namespace portolan {

using Duration = std::chrono::nanoseconds;
// A point in time on the sensors' clock, as nanoseconds since its epoch.
using Timestamp = std::chrono::nanoseconds;

inline double ToSeconds(Duration duration) { return std::chrono::duration<double>(duration).count(); }
inline Duration FromSeconds(double seconds) {
  return Duration(static_cast<int64_t>(std::llround(seconds * 1e9)));
}

}  // namespace portolan

#endif  // PORTOLAN_COMMON_BASE_TIME_H_
