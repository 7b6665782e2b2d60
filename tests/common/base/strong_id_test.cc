#include "common/base/strong_id.h"

#include <sstream>
#include <type_traits>
#include <unordered_set>

#include "gtest/gtest.h"

namespace portolan {
namespace {

TEST(StrongId, DifferentIdsAreDifferentTypes) {
  static_assert(!std::is_convertible_v<SubmapId, LandmarkId>);
  static_assert(!std::is_convertible_v<int64_t, SubmapId>);
  EXPECT_EQ(SubmapId(3).value(), 3);
}

TEST(StrongId, ComparesAndPrintsItsValue) {
  EXPECT_LT(TrackId(2), TrackId(10));
  EXPECT_NE(AgentId("a"), AgentId("b"));
  std::ostringstream out;
  out << AgentId("rover") << " " << TrackId(7);
  EXPECT_EQ(out.str(), "rover 7");
}

TEST(StrongId, IsAKeyOfAHashSet) {
  const std::unordered_set<AgentId> agents = {AgentId("a"), AgentId("b"), AgentId("a")};
  EXPECT_EQ(agents.size(), 2u);
}

}  // namespace
}  // namespace portolan
