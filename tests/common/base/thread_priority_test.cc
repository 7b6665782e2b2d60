#include "common/base/thread_priority.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <thread>

namespace portolan {
namespace {

int Niceness() { return getpriority(PRIO_PROCESS, static_cast<id_t>(gettid())); }

TEST(ThreadPriority, OneThreadYieldsAndTheOthersDoNot) {
  const int before = Niceness();
  int of_thread = 0;
  std::thread thread([&] {
    YieldToOtherThreads();
    of_thread = Niceness();
  });
  thread.join();
  EXPECT_EQ(of_thread, std::max(before, 10));
  EXPECT_EQ(Niceness(), before);
}

}  // namespace
}  // namespace portolan
