#include "common/base/thread_priority.h"

#include <sys/resource.h>
#include <unistd.h>

namespace portolan {

void YieldToOtherThreads() {
  // Linux has a niceness for every thread.
  setpriority(PRIO_PROCESS, static_cast<id_t>(gettid()), 10);
}

}  // namespace portolan
