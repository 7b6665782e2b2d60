// The programs on rendered images: the server is killed in mid run and started again while the
// agents go on. They resume, and the map is that of an undisturbed run.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <iostream>
#include <memory>
#include <set>
#include <thread>
#include <vector>

#include "common/client/map_client.h"
#include "tests/end_to_end/child_process.h"
#include "tests/end_to_end/map_positions.h"
#include "tests/support/matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/synthetic/euroc_writer.h"

namespace portolan {
namespace {

using testing::ChildProcess;
using testing::KeyframePositions;
using testing::ReadKeyframePositions;
using testing::ServerProcess;
using testing::WorstDifference;

constexpr int kFrames = 240;
constexpr int kVehicles = 2;
// The server is killed when its map has this many submaps, of about sixteen.
constexpr uint32_t kSubmapsBeforeTheKill = 2;
// In map units, of which the path has about ten. The restarted server's adjustments start from
// stored states and end elsewhere within their convergence limit; measured: 2e-5.
constexpr double kNumericalNoise = 1e-4;

std::string Name(int vehicle) { return "agent" + std::to_string(vehicle); }

class AgentsAndKilledServerTest : public ::testing::Test {
 protected:
  void SetUp() override {
    synthetic::MissionOptions options;
    options.frames = kFrames;
    options.camera = synthetic::MissionOptions::SmallCamera();
    const auto mission = MakeMission(options);
    ASSERT_THAT(mission, IsOk());
    std::vector<std::thread> threads;
    for (int i = 0; i < kVehicles; ++i) {
      threads.emplace_back([&, i] {
        EXPECT_THAT(WriteEurocAgent(*mission, i, images_.path().string(), {}), IsOk());
      });
    }
    for (std::thread& thread : threads) thread.join();
  }

  ServerProcess Start(const TempDir& folder, const std::string& listen = "127.0.0.1:0") const {
    std::string names;
    for (int i = 0; i < kVehicles; ++i) names += (i > 0 ? "," : "") + Name(i);
    return ServerProcess(
        PORTOLAN_SERVER_PROGRAM, folder.path().string(),
        {"--lockstep", "--lockstep-agents=" + names, "--threads=1", "--log-level=warning"}, listen);
  }

  std::vector<std::unique_ptr<ChildProcess>> StartAgents(const TempDir& folder,
                                                         const std::string& server) const {
    std::vector<std::unique_ptr<ChildProcess>> agents;
    for (int i = 0; i < kVehicles; ++i) {
      const std::string outbox = (folder / (Name(i) + "_outbox")).string();
      agents.push_back(std::make_unique<ChildProcess>(
          PORTOLAN_AGENT_PROGRAM,
          std::vector<std::string>{(images_ / Name(i)).string(), "--agent=" + Name(i),
                                   "--server=" + server, "--outbox=" + outbox, "--no-progress",
                                   "--session=" + std::to_string(i + 1), "--log-level=error"}));
    }
    return agents;
  }

  static void ExpectCleanEnd(const std::vector<std::unique_ptr<ChildProcess>>& agents) {
    for (const auto& agent : agents) EXPECT_EQ(agent->Wait(), 0);
  }

  const TempDir images_;
};

// Returns when the map has so many submaps, or the server ended.
void WaitForSubmaps(const MapClient& client, uint32_t count) {
  EXPECT_THAT(client.FollowChanges(0,
                                   [&](const v1::MapChange&) {
                                     const auto info = client.GetMapInfo();
                                     return info.ok() && info->submap_count() < count;
                                   }),
              IsOk());
}

struct MapContent {
  KeyframePositions keyframes;
  std::multiset<std::pair<std::string, uint64_t>> submaps;  // agent, sequence number
};

MapContent ReadMap(const std::string& server) {
  const MapClient client(server);
  MapContent content{ReadKeyframePositions(client), {}};
  const auto page = client.ListSubmaps({});
  EXPECT_THAT(page, IsOk());
  if (!page.ok()) return content;
  for (const v1::SubmapInfo& submap : page->submaps()) {
    content.submaps.insert({submap.agent_id(), submap.sequence_number()});
  }
  return content;
}

TEST_F(AgentsAndKilledServerTest, AgentsResumeAndTheMapIsTheSame) {
  const TempDir undisturbed_folder, killed_folder;
  MapContent expected;
  {
    ServerProcess server = Start(undisturbed_folder);
    ASSERT_NE(server.address(), "");
    ExpectCleanEnd(StartAgents(undisturbed_folder, server.address()));
    expected = ReadMap(server.address());
    EXPECT_EQ(server.End(SIGTERM), 0);
  }
  ASSERT_GT(expected.submaps.size(), 2 * kSubmapsBeforeTheKill);

  ServerProcess server = Start(killed_folder);
  const std::string address = server.address();
  ASSERT_NE(address, "");
  const auto agents = StartAgents(killed_folder, address);
  WaitForSubmaps(MapClient(address), kSubmapsBeforeTheKill);
  EXPECT_EQ(server.End(SIGKILL), -1);
  const ServerProcess restarted = Start(killed_folder, address);
  ASSERT_EQ(restarted.address(), address);
  ExpectCleanEnd(agents);
  const MapContent map = ReadMap(address);
  EXPECT_EQ(map.submaps, expected.submaps) << "each submap once";
  const double worst = WorstDifference(map.keyframes, expected.keyframes);
  std::cout << "submaps " << map.submaps.size() << ", largest difference of a keyframe: " << worst
            << "\n";
  EXPECT_LT(worst, kNumericalNoise);
}

}  // namespace
}  // namespace portolan
