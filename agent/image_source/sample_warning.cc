#include "agent/image_source/sample_warning.h"

#include "common/base/logging.h"

namespace portolan {
namespace {

// After so many warnings of a kind only the counts go on.
constexpr int64_t kMaxSampleWarnings = 3;

}  // namespace

void WarnOfSample(const char* sensor, Timestamp time, const char* what, int64_t count) {
  if (count > kMaxSampleWarnings) return;
  LogWarning(sensor, " at ", ToSeconds(time), " s: ", what,
             count == kMaxSampleWarnings ? "; further ones are only counted" : "");
}

}  // namespace portolan
