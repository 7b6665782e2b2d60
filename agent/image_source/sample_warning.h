// Warnings about damaged samples of a sensor.
#ifndef PORTOLAN_AGENT_IMAGE_SOURCE_SAMPLE_WARNING_H_
#define PORTOLAN_AGENT_IMAGE_SOURCE_SAMPLE_WARNING_H_

#include <cstdint>

#include "common/base/time.h"

namespace portolan {

// Logs "SENSOR at TIME s: WHAT" for the first three of a kind; `count` is the how-many-eth it is.
void WarnOfSample(const char* sensor, Timestamp time, const char* what, int64_t count);

}  // namespace portolan

#endif  // PORTOLAN_AGENT_IMAGE_SOURCE_SAMPLE_WARNING_H_
