// deploy/agent.yaml is written from the program's own defaults and must stay what they are.
#include <gtest/gtest.h>

#include <cstdio>
#include <fstream>
#include <sstream>
#include <string>

namespace portolan {
namespace {

// What the program prints.
std::string OutputOf(const std::string& command) {
  FILE* pipe = popen(command.c_str(), "r");
  if (pipe == nullptr) return "";
  std::string output;
  for (int c = std::fgetc(pipe); c != EOF; c = std::fgetc(pipe)) output += static_cast<char>(c);
  EXPECT_EQ(pclose(pipe), 0);
  return output;
}

TEST(AgentYaml, HoldsEveryOptionWithItsDefault) {
  std::ifstream file("deploy/agent.yaml");
  std::string title;
  std::getline(file, title);
  EXPECT_EQ(title.find("# "), 0u);
  std::stringstream yaml;
  yaml << file.rdbuf();
  std::string printed = OutputOf(PORTOLAN_AGENT_PROGRAM " --print-config");
  // The file leaves out the option that printed it.
  const std::string own = "# print all options as YAML and end\nprint_config: false\n";
  const size_t at = printed.find(own);
  ASSERT_NE(at, std::string::npos);
  EXPECT_EQ(yaml.str(), printed.erase(at, own.size()));
}

}  // namespace
}  // namespace portolan
