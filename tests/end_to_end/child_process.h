// The programs as child processes.
#ifndef PORTOLAN_TESTS_END_TO_END_CHILD_PROCESS_H_
#define PORTOLAN_TESTS_END_TO_END_CHILD_PROCESS_H_

#include <sys/types.h>

#include <array>
#include <string>
#include <vector>

namespace portolan::testing {

// A program with arguments, its standard output in `output` (a file descriptor, or -1 for ours).
// Killed on destruction.
class ChildProcess {
 public:
  ChildProcess(const std::string& program, std::vector<std::string> arguments, int output = -1);
  ~ChildProcess();
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;

  // Sends the signal and waits for the end; the exit code, or -1 if a signal ended it.
  int End(int signal);
  // Waits for the end; the exit code, or -1 if a signal ended it.
  int Wait();

 private:
  pid_t pid_ = -1;
};

// `program --map=FOLDER/map --listen=ADDRESS arguments`.
class ServerProcess {
 public:
  // Returns once the server listens; address() is empty if it ended before.
  ServerProcess(const std::string& program, const std::string& folder,
                std::vector<std::string> arguments, const std::string& listen = "127.0.0.1:0");

  const std::string& address() const { return address_; }
  int End(int signal) { return process_.End(signal); }

 private:
  ServerProcess(const std::string& program, std::vector<std::string> arguments,
                const std::array<int, 2>& output);

  ChildProcess process_;
  std::string address_;
};

}  // namespace portolan::testing

#endif  // PORTOLAN_TESTS_END_TO_END_CHILD_PROCESS_H_
