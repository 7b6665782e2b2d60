#include "server/ingest/session_table.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/server/support/test_submaps.h"

namespace portolan {
namespace {

using testing::TestSession;

SubmapKey Key(const std::string& agent, uint32_t number) {
  return {AgentId(agent), SessionId(1), number};
}

TEST(SessionTable, CountsWhatIsCommittedAndRejected) {
  SessionTable table;
  table.Add(TestSession("a"), nullptr);
  table.AddCommitted(Key("a", 0), SubmapId(1), 1234);
  table.AddCommitted(Key("a", 2), SubmapId(2), 99);
  table.AddRejected(Key("a", 4));
  const auto session = table.Find(TestSession("a"));
  ASSERT_TRUE(session.has_value());
  EXPECT_EQ(session->submap_count, 2u);
  EXPECT_EQ(session->next_sequence_number, 5u);
  EXPECT_TRUE(table.IsCommitted(Key("a", 2)));
  EXPECT_FALSE(table.IsCommitted(Key("a", 1)));
  EXPECT_FALSE(table.IsCommitted(Key("b", 0)));
  EXPECT_EQ(table.ByteCount(SubmapId(1)), 1234);
  EXPECT_EQ(table.ByteCount(SubmapId(7)), 0);
}

TEST(SessionTable, UnknownSessionsAreNotInvented) {
  SessionTable table;
  table.AddRejected(Key("a", 0));
  EXPECT_FALSE(table.Find(TestSession("a")).has_value());
}

TEST(SessionTable, LivePosesLastAsLongAsTheConnection) {
  SessionTable table;
  table.Add(TestSession("a"), nullptr);
  table.SetLivePose(TestSession("a"), LivePose());
  EXPECT_FALSE(table.Find(TestSession("a"))->live_pose.has_value());
  table.SetConnected(TestSession("a"), true);
  table.SetLivePose(TestSession("a"), LivePose());
  EXPECT_TRUE(table.Find(TestSession("a"))->live_pose.has_value());
  table.SetConnected(TestSession("a"), false);
  EXPECT_FALSE(table.Find(TestSession("a"))->live_pose.has_value());
}

TEST(SessionTable, ListsByAgentThenByCreation) {
  SessionTable table;
  for (const auto& [agent, session] :
       {std::pair("b", 1u), std::pair("a", 9u), std::pair("a", 2u)}) {
    table.Add(TestSession(agent, session), nullptr);
  }
  std::vector<SessionName> names;
  for (const SessionStatus& session : table.List()) names.push_back(session.name);
  EXPECT_THAT(
      names, ::testing::ElementsAre(TestSession("a", 9), TestSession("a", 2), TestSession("b", 1)));
}

}  // namespace
}  // namespace portolan
