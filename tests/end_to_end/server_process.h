// The server program as a child process.
#ifndef PORTOLAN_TESTS_END_TO_END_SERVER_PROCESS_H_
#define PORTOLAN_TESTS_END_TO_END_SERVER_PROCESS_H_

#include <sys/types.h>

#include <string>
#include <vector>

namespace portolan::testing {

// Runs `program --map FILE --listen 127.0.0.1:0 --port-file ... arguments` in a folder. Killed on
// destruction.
class ServerProcess {
 public:
  // Returns once the server listens; address() is empty if it ended before.
  ServerProcess(const std::string& program, const std::string& folder,
                const std::vector<std::string>& arguments);
  ~ServerProcess();
  ServerProcess(const ServerProcess&) = delete;
  ServerProcess& operator=(const ServerProcess&) = delete;

  const std::string& address() const { return address_; }
  // Sends the signal and waits for the end; the exit code, or -1 if a signal ended it.
  int End(int signal);

 private:
  pid_t pid_ = -1;
  std::string address_;
};

}  // namespace portolan::testing

#endif  // PORTOLAN_TESTS_END_TO_END_SERVER_PROCESS_H_
