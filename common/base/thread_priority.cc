#include "common/base/thread_priority.h"

#include <sys/resource.h>
#include <unistd.h>

namespace portolan {

void YieldToOtherThreads() {
  // Linux has a niceness for every thread.
  const auto thread = static_cast<id_t>(gettid());
  if (getpriority(PRIO_PROCESS, thread) < 10) setpriority(PRIO_PROCESS, thread, 10);
}

}  // namespace portolan
