// The server program with real submaps of several agents: killed in mid run and restarted, it ends
// with the same map as without.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <atomic>
#include <iostream>
#include <map>
#include <thread>

#include "common/client/map_client.h"
#include "common/wire/submap_wire.h"
#include "tests/end_to_end/child_process.h"
#include "tests/end_to_end/map_positions.h"
#include "tests/server/support/agent_connection.h"
#include "tests/support/synthetic_submaps.h"
#include "tests/support/temp_dir.h"

namespace portolan {
namespace {

using testing::AgentConnection;
using testing::KeyframePositions;
using testing::ReadKeyframePositions;
using testing::ServerProcess;
using testing::WorstDifference;

// The uploads of each agent of a synthetic mission in which the agents see each other's places.
class Fleet {
 public:
  Fleet() {
    SyntheticSubmapsOptions options;
    options.agents = {{.start_rad = 0, .end_rad = 2, .submaps = 5},
                      {.start_rad = 2.5, .end_rad = 0.5, .submaps = 4},
                      {.start_rad = 1, .end_rad = 3, .submaps = 5}};
    mission_ = MakeSyntheticMission(options);
    for (const SyntheticSubmap& submap : mission_.submaps) {
      const SubmapKey& key = submap.submap->key;
      auto bytes = EncodeSubmap(*submap.submap);
      EXPECT_TRUE(bytes.ok()) << bytes.status();
      uploads_[{key.agent, key.session}].push_back(
          MakeUpload(key.sequence_number, bytes.value_or("")));
    }
  }

  // All agents upload what the server lacks and finish, or until `stop_after` submaps were
  // acknowledged in total; then `on_stop` is called, once.
  void Run(const std::string& address, int stop_after = -1,
           const std::function<void()>& on_stop = nullptr) {
    std::atomic<int> acknowledged = 0;
    std::vector<std::thread> threads;
    for (const auto& [session, uploads] : uploads_) {
      threads.emplace_back([&, session = session, uploads = &uploads] {
        RunAgent(address, session, *uploads, [&] {
          if (++acknowledged == stop_after) on_stop();
        });
      });
    }
    for (std::thread& thread : threads) thread.join();
  }

  std::string names() const {
    std::string names;
    for (const auto& [session, uploads] : uploads_) {
      names += (names.empty() ? "" : ",") + session.first.value();
    }
    return names;
  }
  uint32_t submap_count() const { return static_cast<uint32_t>(mission_.submaps.size()); }
  int finished_count() const { return finished_; }

 private:
  using Session = std::pair<AgentId, SessionId>;

  void RunAgent(const std::string& address, const Session& session,
                const std::vector<v1::SubmapUpload>& uploads,
                const std::function<void()>& on_acknowledged) {
    AgentConnection connection(address);
    SessionHello hello;
    hello.agent = session.first;
    hello.session = session.second;
    hello.camera = mission_.camera->intrinsics();
    const auto welcome = connection.Hello(hello);
    if (!welcome) return;
    for (size_t i = welcome->next_sequence_number(); i < uploads.size(); ++i) {
      if (!connection.SendUpload(uploads[i])) return;
      const auto ack = connection.WaitForAck();
      if (!ack) return;
      EXPECT_EQ(ack->verdict(), v1::SUBMAP_VERDICT_ACCEPTED) << ack->reason();
      on_acknowledged();
    }
    finished_ += connection.Finish().has_value();
  }

  SyntheticMission mission_;
  std::map<Session, std::vector<v1::SubmapUpload>> uploads_;
  std::atomic<int> finished_ = 0;
};

class ServerRestartTest : public ::testing::Test {
 protected:
  ServerProcess Start(const TempDir& folder, std::vector<std::string> arguments = {}) {
    arguments.insert(arguments.end(), {"--lockstep", "--lockstep-agents=" + fleet_.names(),
                                       "--threads=1", "--log-level=warning"});
    return ServerProcess(PORTOLAN_SERVER_PROGRAM, folder.path().string(), arguments);
  }

  Fleet fleet_;
};

TEST_F(ServerRestartTest, KilledServerEndsWithTheSameMap) {
  const TempDir undisturbed_folder, killed_folder;
  ServerProcess undisturbed = Start(undisturbed_folder);
  ASSERT_NE(undisturbed.address(), "");
  fleet_.Run(undisturbed.address());
  ASSERT_EQ(fleet_.finished_count(), 3);
  const auto expected = ReadKeyframePositions(MapClient(undisturbed.address()));
  EXPECT_EQ(undisturbed.End(SIGTERM), 0);

  {
    ServerProcess killed = Start(killed_folder);
    fleet_.Run(killed.address(), fleet_.submap_count() / 2, [&] { killed.End(SIGKILL); });
  }
  ServerProcess restarted = Start(killed_folder);
  fleet_.Run(restarted.address());
  ASSERT_EQ(fleet_.finished_count(), 6);
  const MapClient client(restarted.address());
  const auto info = client.GetMapInfo();
  ASSERT_TRUE(info.ok()) << info.status();
  EXPECT_EQ(info->submap_count(), fleet_.submap_count()) << "each acknowledged submap once";
  EXPECT_EQ(info->components_size(), 1);
  const double worst = WorstDifference(ReadKeyframePositions(client), expected);
  std::cout << "largest difference of a keyframe: " << worst << "\n";
  EXPECT_LT(worst, 1e-6);
}

TEST_F(ServerRestartTest, RebuildGivesTheSameMap) {
  const TempDir folder;
  KeyframePositions expected;
  {
    ServerProcess server = Start(folder);
    ASSERT_NE(server.address(), "");
    fleet_.Run(server.address());
    expected = ReadKeyframePositions(MapClient(server.address()));
    EXPECT_EQ(server.End(SIGTERM), 0);
  }
  ServerProcess server = Start(folder, {"--rebuild"});
  const MapClient client(server.address());
  ASSERT_TRUE(client.Settle(std::chrono::minutes(5)).ok());
  const double worst = WorstDifference(ReadKeyframePositions(client), expected);
  std::cout << "largest difference of a keyframe: " << worst << "\n";
  EXPECT_LT(worst, 1e-6);
}

TEST_F(ServerRestartTest, QueriesAnswerAfterACleanRestart) {
  const TempDir folder;
  v1::QueryLandmarksRequest request;
  request.mutable_nearest()->mutable_point()->set_x(1);
  request.mutable_nearest()->set_count(10);
  std::string before;
  {
    ServerProcess server = Start(folder);
    ASSERT_NE(server.address(), "");
    fleet_.Run(server.address());
    const auto page = MapClient(server.address()).QueryLandmarks(request);
    ASSERT_TRUE(page.ok()) << page.status();
    EXPECT_EQ(page->landmarks_size(), 10);
    before = page->SerializeAsString();
    EXPECT_EQ(server.End(SIGINT), 0);
  }
  ServerProcess server = Start(folder);
  const auto page = MapClient(server.address()).QueryLandmarks(request);
  ASSERT_TRUE(page.ok()) << page.status();
  EXPECT_EQ(page->SerializeAsString(), before);
}

TEST_F(ServerRestartTest, WrongCommandLinesEndAtOnce) {
  const TempDir folder;
  ServerProcess server(PORTOLAN_SERVER_PROGRAM, folder.path().string(), {"--lockstep"});
  EXPECT_EQ(server.address(), "");
  EXPECT_EQ(server.End(0), 2);
}

}  // namespace
}  // namespace portolan
