#include "tests/end_to_end/child_process.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cstdio>

#include "common/base/check.h"

namespace portolan::testing {
namespace {

std::array<int, 2> MakePipe() {
  std::array<int, 2> ends{};
  PORTOLAN_CHECK(pipe2(ends.data(), O_CLOEXEC) == 0);
  return ends;
}

std::vector<std::string> ServerArguments(const std::string& folder,
                                         std::vector<std::string> arguments,
                                         const std::string& listen) {
  arguments.insert(arguments.begin(), {"--map=" + folder + "/map", "--listen=" + listen});
  return arguments;
}

}  // namespace

ChildProcess::ChildProcess(const std::string& program, std::vector<std::string> arguments,
                           int output) {
  arguments.insert(arguments.begin(), program);
  std::vector<char*> pointers;
  for (std::string& word : arguments) pointers.push_back(word.data());
  pointers.push_back(nullptr);
  pid_ = fork();
  if (pid_ == 0) {
    if (output >= 0) dup2(output, STDOUT_FILENO);
    execv(pointers[0], pointers.data());
    _exit(127);
  }
}

ChildProcess::~ChildProcess() {
  if (pid_ > 0) End(SIGKILL);
}

int ChildProcess::End(int signal) {
  kill(pid_, signal);
  return Wait();
}

int ChildProcess::Wait() {
  int status = 0;
  waitpid(pid_, &status, 0);
  pid_ = -1;
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

ServerProcess::ServerProcess(const std::string& program, const std::string& folder,
                             std::vector<std::string> arguments, const std::string& listen)
    : ServerProcess(program, ServerArguments(folder, std::move(arguments), listen), MakePipe()) {}

ServerProcess::ServerProcess(const std::string& program, std::vector<std::string> arguments,
                             const std::array<int, 2>& output)
    : process_(program, std::move(arguments), output[1]) {
  close(output[1]);
  // "listening on HOST:PORT"; the end of the file if the program ends before.
  FILE* lines = fdopen(output[0], "r");
  char address[100];
  if (fscanf(lines, "listening on %99s", address) == 1) address_ = address;
  fclose(lines);
}

}  // namespace portolan::testing
