#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <future>
#include <thread>

#include "common/base/logging.h"
#include "tests/server/rpc/server_fixture.h"

namespace portolan {
namespace {

using testing::AgentConnection;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing::MakeTestUpload;
using testing::TestHello;

class AgentStreamTest : public testing::ServerFixture {
 protected:
  // Sends one message as the first and returns how the server ends the stream.
  grpc::Status StatusAfter(const v1::AgentMessage& message) {
    AgentConnection connection(server_->address());
    connection.Send(message);
    return connection.status();
  }
};

TEST_F(AgentStreamTest, SubmapsAreAcknowledgedCorrectedAndFinished) {
  Start();
  auto agent = Connect("a");
  EXPECT_EQ(welcome_->next_sequence_number(), 0u);
  Upload(agent.get(), "a", 0, 2);
  const auto finished = agent->Finish();
  ASSERT_TRUE(finished.has_value());
  EXPECT_EQ(finished->map_version(), 3u);
  std::map<uint32_t, double> x;
  for (const v1::Correction& correction : agent->corrections()) {
    for (const v1::SubmapCorrection& submap : correction.submaps()) {
      x[submap.sequence_number()] = submap.world_from_submap().translation().x();
    }
  }
  EXPECT_THAT(x, ElementsAre(std::pair(0u, 10.0), std::pair(1u, 20.0), std::pair(2u, 30.0)));
  EXPECT_FALSE(agent->corrections().back().more());
  EXPECT_EQ(agent->corrections().back().map_version(), 3u);
  EXPECT_TRUE(agent->status().ok());
}

TEST_F(AgentStreamTest, ReconnectionResumes) {
  Start();
  {
    auto agent = Connect("a");
    Upload(agent.get(), "a", 0, 4);
    agent->Drop();
  }
  auto agent = Connect("a");
  EXPECT_EQ(welcome_->next_sequence_number(), 5u);
  Upload(agent.get(), "a", 4, 6);  // 4 a second time
  ASSERT_TRUE(agent->Finish().has_value());
  EXPECT_EQ(client_->GetMapInfo()->submap_count(), 7u);
}

TEST_F(AgentStreamTest, RestartedServerResumesSessionsAndVersions) {
  Start();
  {
    auto agent = Connect("a");
    Upload(agent.get(), "a", 0, 4);
    Settle();
  }
  Stop();
  Start();
  auto agent = Connect("a", 1, /*received_map_version=*/3);
  EXPECT_EQ(welcome_->next_sequence_number(), 5u);
  EXPECT_EQ(welcome_->map_version(), 5u);
  const auto correction = agent->WaitForCorrection();
  ASSERT_TRUE(correction.has_value());
  ASSERT_EQ(correction->submaps_size(), 2) << "those of versions 4 and 5";
  EXPECT_EQ(correction->submaps(0).sequence_number(), 3u);
}

TEST_F(AgentStreamTest, RebuildKeepsVersionsAscending) {
  Start();
  {
    auto agent = Connect("a");
    Upload(agent.get(), "a", 0, 2);
    Settle();
  }
  Stop();
  ServerOptions options;
  options.rebuild = true;
  Start(options);
  EXPECT_EQ(Settle(), 6u);
  EXPECT_EQ(client_->GetMapInfo()->submap_count(), 3u);
}

TEST_F(AgentStreamTest, SecondStreamOfASessionEndsTheFirst) {
  Start();
  auto first = Connect("a");
  auto second = Connect("a");
  EXPECT_EQ(first->status().error_code(), grpc::StatusCode::ABORTED);
  Upload(second.get(), "a", 0, 0);
  EXPECT_EQ(client_->GetMapInfo()->connected_agent_count(), 1u);
}

TEST_F(AgentStreamTest, MalformedBeginningsAreRefused) {
  Start();
  v1::AgentMessage message;
  *message.mutable_submap() = MakeTestUpload("a", 0);
  EXPECT_EQ(StatusAfter(message).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  ToProto(TestHello("a"), message.mutable_hello());
  message.mutable_hello()->set_protocol_version(99);
  EXPECT_EQ(StatusAfter(message).error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  message.mutable_hello()->set_protocol_version(kProtocolVersion);
  message.mutable_hello()->set_agent_id("../etc");
  EXPECT_EQ(StatusAfter(message).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
}

TEST_F(AgentStreamTest, AnotherCameraContradictsTheSession) {
  Start();
  Connect("a");
  SessionHello hello = TestHello("a");
  hello.camera.fx_px = 400;
  AgentConnection connection(server_->address());
  EXPECT_FALSE(connection.Hello(hello).has_value());
  EXPECT_EQ(connection.status().error_code(), grpc::StatusCode::FAILED_PRECONDITION);
}

TEST_F(AgentStreamTest, RejectedSubmapDoesNotEndTheStream) {
  Start();
  auto agent = Connect("a");
  v1::SubmapUpload damaged = MakeTestUpload("a", 0);
  damaged.set_crc32c(damaged.crc32c() ^ 1);
  ASSERT_TRUE(agent->SendUpload(damaged));
  const auto ack = agent->WaitForAck();
  ASSERT_TRUE(ack.has_value());
  EXPECT_EQ(ack->verdict(), v1::SUBMAP_VERDICT_REJECTED);
  EXPECT_NE(ack->reason(), "");
  Upload(agent.get(), "a", 1, 1);
}

TEST_F(AgentStreamTest, LivePoseIsPlacedByThePredecessor) {
  Start();
  auto agent = Connect("a");
  Upload(agent.get(), "a", 0, 0);
  Settle();
  LivePose pose;
  pose.time = std::chrono::seconds(102);
  pose.sequence_number = 1;
  pose.submap_from_camera.translation = Eigen::Vector3d(0.5, 0, 0);
  pose.predecessor_from_submap = Rigid3();
  v1::AgentMessage message;
  ToProto(pose, message.mutable_live_pose());
  ASSERT_TRUE(agent->Send(message));
  Upload(agent.get(), "a", 0, 0);  // its verdict comes after the pose was handled
  const auto agents = client_->ListAgents();
  ASSERT_TRUE(agents.ok()) << agents.status();
  const v1::SessionInfo& session = agents->agents(0).sessions(0);
  EXPECT_TRUE(session.connected());
  // Submap 0 lies at x = 10 with scale 2, its last keyframe one unit on; then half a unit more.
  EXPECT_DOUBLE_EQ(session.world_from_camera().translation().x(), 13);
}

TEST_F(AgentStreamTest, AgentThatNeverReadsIsCutOff) {
  SetLogLevel(LogLevel::kError);  // a line for every submap otherwise
  Start();
  auto agent = Connect("a");
  v1::SubmapUpload damaged = MakeTestUpload("a", 0);
  damaged.set_crc32c(damaged.crc32c() ^ 1);
  // Some hundred answers fit into the network's buffers, a thousand are queued.
  int sent = 0;
  while (sent < 40000 && agent->SendUpload(damaged)) ++sent;
  EXPECT_LT(sent, 40000);
  EXPECT_EQ(agent->status().error_code(), grpc::StatusCode::CANCELLED);
  auto again = Connect("a");
  Upload(again.get(), "a", welcome_->next_sequence_number(), 3);
  SetLogLevel(LogLevel::kInfo);
}

TEST_F(AgentStreamTest, TooManyAgentsAreTurnedAway) {
  ServerOptions options;
  options.max_agents = 2;
  Start(options);
  auto a = Connect("a");
  auto b = Connect("b");
  AgentConnection c(server_->address());
  EXPECT_FALSE(c.Hello(TestHello("c")).has_value());
  EXPECT_EQ(c.status().error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
}

TEST_F(AgentStreamTest, ShutdownTellsAgentsAndKeepsTheMap) {
  Start();
  auto agent = Connect("a");
  Upload(agent.get(), "a", 0, 1);
  std::future<grpc::Status> status = std::async(
      std::launch::async, [&] { return agent->Finish() ? grpc::Status::OK : agent->status(); });
  status.get();
  auto other = Connect("b");
  server_->Shutdown();
  EXPECT_EQ(other->status().error_code(), grpc::StatusCode::UNAVAILABLE);
  Stop();
  Start();
  EXPECT_EQ(client_->GetMapInfo()->submap_count(), 2u);
}

TEST_F(AgentStreamTest, ManyAgentsAtOnceLoseNothing) {
  Start();
  constexpr int kAgents = 24;
  std::vector<std::thread> threads;
  std::atomic<int> finished = 0;
  for (int i = 0; i < kAgents; ++i) {
    threads.emplace_back([&, name = "agent" + std::to_string(i)] {
      AgentConnection connection(server_->address());
      if (!connection.Hello(TestHello(name))) return;
      for (uint32_t number = 0; number < 5; ++number) {
        connection.SendUpload(MakeTestUpload(name, number));  // all before the first verdict
      }
      finished += connection.Finish().has_value();
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(finished, kAgents);
  const auto info = client_->GetMapInfo();
  ASSERT_TRUE(info.ok()) << info.status();
  EXPECT_EQ(info->submap_count(), 5u * kAgents);
  EXPECT_EQ(info->agent_count(), static_cast<uint32_t>(kAgents));
}

TEST_F(AgentStreamTest, LockstepOrderDoesNotDependOnArrival) {
  ServerOptions options;
  options.ingest.lockstep_agents = {AgentId("a"), AgentId("b")};
  Start(options, {.has_background_work = true});
  auto a = Connect("a");
  auto b = Connect("b");
  for (uint32_t i = 0; i < 3; ++i) b->SendUpload(MakeTestUpload("b", i));
  for (uint32_t i = 0; i < 2; ++i) a->SendUpload(MakeTestUpload("a", i));
  std::future<bool> b_finished =
      std::async(std::launch::async, [&] { return b->Finish().has_value(); });
  EXPECT_TRUE(a->Finish().has_value());
  EXPECT_TRUE(b_finished.get());
  std::vector<std::string> integrated;
  for (const std::string& event : probe_->events()) {
    if (event.starts_with("integrate")) integrated.push_back(event);
  }
  EXPECT_THAT(integrated, ElementsAre("integrate a/0", "integrate b/0", "integrate a/1",
                                      "integrate b/1", "integrate b/2"));
}

}  // namespace
}  // namespace portolan
