// Memory of a process as the kernel counts it.
#ifndef PORTOLAN_TESTS_BENCHMARK_REPLAY_PROCESS_MEMORY_H_
#define PORTOLAN_TESTS_BENCHMARK_REPLAY_PROCESS_MEMORY_H_

#include <fstream>
#include <string>

namespace portolan {

// A line of /proc/PID/status such as "VmRSS" or "VmHWM" in MB; 0 if there is none.
inline double ProcessMemoryMb(const std::string& pid, const std::string& name) {
  std::ifstream status("/proc/" + pid + "/status");
  for (std::string word; status >> word;) {
    if (word != name + ":") continue;
    double kilobytes = 0;
    status >> kilobytes;
    return kilobytes / 1024;
  }
  return 0;
}

}  // namespace portolan

#endif  // PORTOLAN_TESTS_BENCHMARK_REPLAY_PROCESS_MEMORY_H_
