// The commands against a server in the test's process.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

#include "server/cli/command.h"
#include "tests/server/rpc/server_fixture.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;

class CommandsTest : public testing::ServerFixture {
 protected:
  void StartWithMap() {
    Start();
    auto agent = Connect("a");
    Upload(agent.get(), "a", 0, 2);
    ASSERT_TRUE(agent->Finish().has_value());
  }
  // Runs a command against the server; what it prints ends up in output_.
  int Run(int (*command)(std::span<const std::string>), std::vector<std::string> args) {
    args.push_back("--server=" + server_->address());
    ::testing::internal::CaptureStdout();
    const int exit_code = command(args);
    output_ = ::testing::internal::GetCapturedStdout();
    return exit_code;
  }
  static std::string ReadFile(const std::filesystem::path& path) {
    std::ifstream file(path);
    std::stringstream text;
    text << file.rdbuf();
    return text.str();
  }

  std::string output_;
};

TEST_F(CommandsTest, InfoAsTextAndJson) {
  StartWithMap();
  EXPECT_EQ(Run(RunInfo, {}), kExitOk);
  EXPECT_THAT(output_, HasSubstr("submaps         3"));
  EXPECT_EQ(Run(RunInfo, {"--json"}), kExitOk);
  EXPECT_THAT(output_, HasSubstr("\"submap_count\":3"));
}

TEST_F(CommandsTest, AgentsAndSubmaps) {
  StartWithMap();
  EXPECT_EQ(Run(RunAgents, {}), kExitOk);
  EXPECT_THAT(output_, HasSubstr("a session 0000000000000001: 3 submaps"));
  EXPECT_EQ(Run(RunSubmaps, {"--agent", "a"}), kExitOk);
  EXPECT_THAT(output_, HasSubstr("3 a #2 component 1: 2 keyframes"));
  EXPECT_EQ(Run(RunSubmaps, {"--agent", "b"}), kExitOk);
  EXPECT_EQ(output_, "");
}

TEST_F(CommandsTest, LandmarksNearABoxAndASphere) {
  StartWithMap();
  EXPECT_EQ(Run(RunLandmarks, {"--near", "10,-1,0", "-k", "3"}), kExitOk);
  EXPECT_EQ(std::count(output_.begin(), output_.end(), '\n'), 4) << output_;
  EXPECT_EQ(Run(RunLandmarks, {"--box=-100,-100,-100,100,100,100"}), kExitOk);
  EXPECT_EQ(std::count(output_.begin(), output_.end(), '\n'), 16);
  EXPECT_EQ(Run(RunLandmarks, {"--sphere", "20,0,0,1000", "--json"}), kExitOk);
  EXPECT_THAT(output_, HasSubstr("\"landmark_id\""));
}

TEST_F(CommandsTest, WrongCommandLinesAreUsageErrors) {
  Start();
  EXPECT_EQ(Run(RunLandmarks, {}), kExitUsage);
  EXPECT_EQ(Run(RunLandmarks, {"--near", "1,2"}), kExitUsage);
  EXPECT_EQ(Run(RunLandmarks, {"--near", "1,2,3", "--sphere", "1,2,3,4"}), kExitUsage);
  EXPECT_EQ(Run(RunInfo, {"--colour"}), kExitUsage);
  EXPECT_EQ(Run(RunInfo, {"extra"}), kExitUsage);
  EXPECT_EQ(Run(RunExport, {"obj"}), kExitUsage);
}

TEST_F(CommandsTest, HelpNamesEveryFlag) {
  Start();
  EXPECT_EQ(Run(RunLandmarks, {"--help"}), kExitOk);
  for (const char* flag : {"--box", "--sphere", "--near", "--k", "--component", "--json"}) {
    EXPECT_THAT(output_, HasSubstr(flag));
  }
}

TEST_F(CommandsTest, TrajectoryAndExports) {
  StartWithMap();
  EXPECT_EQ(Run(RunTrajectory, {"--agent", "a"}), kExitOk);
  EXPECT_EQ(std::count(output_.begin(), output_.end(), '\n'), 1 + 4) << output_;
  EXPECT_EQ(Run(RunTrajectory, {"--agent", "a", "--all-frames"}), kExitOk);
  EXPECT_EQ(std::count(output_.begin(), output_.end(), '\n'), 1 + 7);
  EXPECT_EQ(Run(RunExport, {"tum", "--out", directory_.path().string()}), kExitOk);
  EXPECT_THAT(ReadFile(directory_ / "a.tum"), HasSubstr("100.000000000 10 0 0 0 0 0 1"));
  const std::string ply = (directory_ / "map.ply").string();
  EXPECT_EQ(Run(RunExport, {"ply", "--out", ply}), kExitOk);
  EXPECT_THAT(ReadFile(ply), HasSubstr("element vertex 15"));
  EXPECT_EQ(Run(RunExport, {"g2o"}), kExitOk);
  EXPECT_THAT(output_, HasSubstr("EDGE_SE3:QUAT 1 2 "));
}

TEST_F(CommandsTest, SettlePrintsTheVersion) {
  StartWithMap();
  EXPECT_EQ(Run(RunSettle, {}), kExitOk);
  EXPECT_EQ(output_, "3\n");
  EXPECT_EQ(Run(RunFollow, {"--count", "1"}), kExitOk);
  EXPECT_THAT(output_, HasSubstr("version 3: 3 submaps"));
}

TEST_F(CommandsTest, NoServerFails) {
  const std::vector<std::string> args = {"--server=127.0.0.1:1", "--timeout_s=5"};
  ::testing::internal::CaptureStderr();
  EXPECT_EQ(RunInfo(args), kExitFailed);
  EXPECT_THAT(::testing::internal::GetCapturedStderr(), HasSubstr("127.0.0.1:1"));
}

}  // namespace
}  // namespace portolan
