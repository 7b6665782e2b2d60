#include "tests/end_to_end/server_process.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>

namespace portolan::testing {

ServerProcess::ServerProcess(const std::string& program, const std::string& folder,
                             const std::vector<std::string>& arguments) {
  std::vector<std::string> words = {program, "--map=" + folder + "/map", "--listen=127.0.0.1:0"};
  words.insert(words.end(), arguments.begin(), arguments.end());
  std::vector<char*> pointers;
  for (std::string& word : words) pointers.push_back(word.data());
  pointers.push_back(nullptr);
  int output[2];
  if (pipe2(output, O_CLOEXEC) != 0) return;
  pid_ = fork();
  if (pid_ == 0) {
    dup2(output[1], STDOUT_FILENO);
    execv(pointers[0], pointers.data());
    _exit(127);
  }
  close(output[1]);
  // "listening on HOST:PORT"; the end of the file if the program ends before.
  FILE* lines = fdopen(output[0], "r");
  char address[100];
  if (fscanf(lines, "listening on %99s", address) == 1) address_ = address;
  fclose(lines);
}

ServerProcess::~ServerProcess() {
  if (pid_ > 0) End(SIGKILL);
}

int ServerProcess::End(int signal) {
  kill(pid_, signal);
  int status = 0;
  waitpid(pid_, &status, 0);
  pid_ = -1;
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

}  // namespace portolan::testing
