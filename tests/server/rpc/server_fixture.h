// A server with a stand-in for the map builder, in the test's process.
#ifndef PORTOLAN_TESTS_SERVER_RPC_SERVER_FIXTURE_H_
#define PORTOLAN_TESTS_SERVER_RPC_SERVER_FIXTURE_H_

#include <gtest/gtest.h>

#include <memory>
#include <string>

#include "common/client/map_client.h"
#include "server/server.h"
#include "tests/server/support/agent_connection.h"
#include "tests/server/support/fake_map_engine.h"
#include "tests/server/support/test_submaps.h"
#include "tests/support/temp_dir.h"

namespace portolan::testing {

class ServerFixture : public ::testing::Test {
 protected:
  void Start(ServerOptions options = {}, const FakeMapEngineOptions& engine = {}) {
    options.listen = "127.0.0.1:0";
    options.map_file = (directory_ / "map").string();
    auto server = Server::Start(options, std::make_unique<FakeMapEngine>(engine, probe_));
    ASSERT_TRUE(server.ok()) << server.status();
    server_ = *std::move(server);
    client_ = std::make_unique<MapClient>(server_->address());
  }
  void Stop() { server_.reset(); }

  std::unique_ptr<AgentConnection> Connect(const std::string& agent, uint64_t session = 1,
                                           uint64_t received_map_version = 0) {
    auto connection = std::make_unique<AgentConnection>(server_->address());
    SessionHello hello = TestHello(agent, session);
    hello.received_map_version = received_map_version;
    welcome_ = connection->Hello(hello);
    EXPECT_TRUE(welcome_.has_value());
    return connection;
  }
  // Uploads submaps first..last and waits for each verdict.
  static void Upload(AgentConnection* connection, const std::string& agent, uint32_t first,
                     uint32_t last, uint64_t session = 1) {
    for (uint32_t number = first; number <= last; ++number) {
      ASSERT_TRUE(connection->SendUpload(MakeTestUpload(agent, number, session)));
      const auto ack = connection->WaitForAck();
      ASSERT_TRUE(ack.has_value());
      EXPECT_EQ(ack->sequence_number(), number);
      EXPECT_EQ(ack->verdict(), v1::SUBMAP_VERDICT_ACCEPTED) << ack->reason();
    }
  }
  uint64_t Settle() {
    const auto version = client_->Settle(std::chrono::seconds(30));
    EXPECT_TRUE(version.ok()) << version.status();
    return version.value_or(0);
  }

  TempDir directory_;
  const std::shared_ptr<EngineProbe> probe_ = std::make_shared<EngineProbe>();
  std::unique_ptr<Server> server_;
  std::unique_ptr<MapClient> client_;
  std::optional<v1::Welcome> welcome_;
};

}  // namespace portolan::testing

#endif  // PORTOLAN_TESTS_SERVER_RPC_SERVER_FIXTURE_H_
