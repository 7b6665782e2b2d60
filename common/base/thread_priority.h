// The priority of a thread among all that want the processor.
#ifndef PORTOLAN_COMMON_BASE_THREAD_PRIORITY_H_
#define PORTOLAN_COMMON_BASE_THREAD_PRIORITY_H_

namespace portolan {

// From now on the calling thread leaves the processor to threads of ordinary priority that want it
// (niceness 10: it has a tenth of what they have), if it does not do so already. Does nothing if
// the system refuses.
void YieldToOtherThreads();

}  // namespace portolan

#endif  // PORTOLAN_COMMON_BASE_THREAD_PRIORITY_H_
