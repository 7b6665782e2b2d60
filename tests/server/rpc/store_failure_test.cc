// The server when its disk fails.
#include <gtest/gtest.h>

#include "server/server.h"
#include "tests/server/support/agent_connection.h"
#include "tests/server/support/fake_map_engine.h"
#include "tests/server/support/generic_call.h"
#include "tests/server/support/memory_map_store.h"
#include "tests/server/support/test_submaps.h"

namespace portolan {
namespace {

using google::protobuf::UnknownFieldSet;

TEST(StoreFailure, NothingIsAcknowledgedAndHealthSaysSo) {
  auto owned_store = std::make_unique<testing::MemoryMapStore>();
  testing::MemoryMapStore* store = owned_store.get();
  ServerOptions options;
  options.listen = "127.0.0.1:0";
  auto server =
      Server::Start(options,
                    std::make_unique<testing::FakeMapEngine>(
                        testing::FakeMapEngineOptions(), std::make_shared<testing::EngineProbe>()),
                    std::move(owned_store));
  ASSERT_TRUE(server.ok()) << server.status();
  testing::AgentConnection agent((*server)->address());
  ASSERT_TRUE(agent.Hello(testing::TestHello("a")).has_value());
  store->Fail();
  ASSERT_TRUE(agent.SendUpload(testing::MakeTestUpload("a", 0)));
  EXPECT_FALSE(agent.WaitForAck().has_value());
  EXPECT_EQ(agent.status().error_code(), grpc::StatusCode::UNAVAILABLE);
  UnknownFieldSet request;
  const auto health =
      testing::GenericCall((*server)->address(), "/grpc.health.v1.Health/Check", request);
  ASSERT_TRUE(health.ok()) << health.status();
  EXPECT_EQ((*health)->field(0).varint(), 2u) << "NOT_SERVING";
}

TEST(ServerStart, ErrorsNameTheirCause) {
  const auto start = [](ServerOptions options) {
    return Server::Start(
               options,
               std::make_unique<testing::FakeMapEngine>(testing::FakeMapEngineOptions(),
                                                        std::make_shared<testing::EngineProbe>()),
               std::make_unique<testing::MemoryMapStore>())
        .status();
  };
  ServerOptions options;
  options.listen = "no such host:1";
  EXPECT_TRUE(absl::IsUnavailable(start(options)));
  options = {};
  options.max_agents = 0;
  EXPECT_TRUE(absl::IsInvalidArgument(start(options)));
}

}  // namespace
}  // namespace portolan
