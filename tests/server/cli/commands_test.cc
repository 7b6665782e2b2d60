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

TEST_F(CommandsTest, ControlPointsComeAndGo) {
  StartWithMap();
  EXPECT_EQ(
      Run(RunControlPoints, {"add", "--id", "P12", "--position", "2600010,1200020,395",
                             "--observation", "a:100.0:320:240,a/1:101000000000ns:330.5:241:0.5"}),
      kExitFailed);  // too far from the origin of a grid that nobody named
  EXPECT_EQ(Run(RunControlPoints, {"origin", "--position", "2600000,1200000,400"}), kExitOk);
  EXPECT_THAT(output_, HasSubstr("origin: grid 2600000.000 1200000.000 400.000"));
  EXPECT_EQ(
      Run(RunControlPoints, {"add", "--id", "P12", "--position", "2600010,1200020,395",
                             "--observation", "a:100.0:320:240,a/1:101000000000ns:330.5:241:0.5"}),
      kExitOk);
  EXPECT_EQ(Run(RunControlPoints, {"list"}), kExitOk);
  EXPECT_THAT(output_, HasSubstr("P12 grid 2600010.0000 1200020.0000 395.0000 sigma 0.0200 m, 2"));
  EXPECT_EQ(Run(RunControlPoints, {"remove", "--id", "P12"}), kExitOk);
  EXPECT_EQ(Run(RunControlPoints, {"remove", "--id", "P12"}), kExitFailed);
  EXPECT_EQ(Run(RunGeoreference, {}), kExitOk);
  EXPECT_THAT(output_, HasSubstr("neither positions"));
}

TEST_F(CommandsTest, ControlPointsSayWhatIsWrong) {
  StartWithMap();
  const auto error_of = [&](std::vector<std::string> args) {
    ::testing::internal::CaptureStderr();
    EXPECT_NE(Run(RunControlPoints, std::move(args)), kExitOk);
    return ::testing::internal::GetCapturedStderr();
  };
  EXPECT_THAT(error_of({}), HasSubstr("name an action"));
  EXPECT_THAT(error_of({"add", "--id", "P", "--wgs84", "1,2"}), HasSubstr("3 numbers"));
  EXPECT_THAT(error_of({"add", "--id", "P", "--wgs84", "1,2,3", "--observation", "a:100:1:2"}),
              HasSubstr("at least 2"));
  EXPECT_THAT(
      error_of({"add", "--id", "P", "--wgs84", "1,2,3", "--observation", "a:100:1:2,a:100.25:1:2"}),
      HasSubstr("no keyframe at 100250000000 ns; the nearest one is at 100000000000 ns"));
  EXPECT_THAT(
      error_of({"add", "--id", "P", "--wgs84", "1,2,3", "--observation", "b:100:1:2,a:100:1:2"}),
      HasSubstr("no submap of agent b"));
  EXPECT_THAT(
      error_of({"add", "--id", "P", "--wgs84", "95,2,3", "--observation", "a:100:1:2,a:101:1:2"}),
      HasSubstr("latitude"));
}

TEST_F(CommandsTest, ControlPointsAreImportedFromAFile) {
  StartWithMap();
  const std::string path = (directory_ / "points.csv").string();
  std::ofstream(path) << "# id,system,x,y,z,sigma_m,observations\n"
                         "P1,wgs84,47.1,8.5,400,0.02,a:100:1:2 a:101:1:2\n"
                         "P2,wgs84,47.1,8.5001,400,0.02,a:100:5:2 a:102:1:2:0.5\n";
  EXPECT_EQ(Run(RunControlPoints, {"import", path}), kExitOk);
  EXPECT_EQ(std::count(output_.begin(), output_.end(), '\n'), 2) << output_;
  EXPECT_EQ(Run(RunControlPoints, {"import", path}), kExitFailed);  // they are there already
  EXPECT_EQ(Run(RunControlPoints, {"import", path, "--replace"}), kExitOk);
  EXPECT_EQ(Run(RunControlPoints, {"import", path + "x"}), kExitFailed);
}

TEST_F(CommandsTest, OtherFramesNeedAGeoreference) {
  StartWithMap();
  EXPECT_EQ(Run(RunTrajectory, {"--agent", "a", "--frame", "wgs84"}), kExitFailed);
  EXPECT_EQ(Run(RunLandmarks, {"--near", "10,-1,0", "--frame", "grid"}), kExitFailed);
  EXPECT_EQ(Run(RunTrajectory, {"--agent", "a", "--frame", "moon"}), kExitUsage);
}

TEST_F(CommandsTest, NoServerFails) {
  const std::vector<std::string> args = {"--server=127.0.0.1:1", "--timeout_s=5"};
  ::testing::internal::CaptureStderr();
  EXPECT_EQ(RunInfo(args), kExitFailed);
  EXPECT_THAT(::testing::internal::GetCapturedStderr(), HasSubstr("127.0.0.1:1"));
}

}  // namespace
}  // namespace portolan
