#include "common/base/keep_latest.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>

namespace portolan {
namespace {

using ::testing::ElementsAre;
using ::testing::Pair;

struct Entry {
  int seen_at = 0;
};

std::map<int, int> Kept(int max_count) {
  std::map<int, Entry> entries = {{1, {7}}, {2, {5}}, {3, {5}}, {4, {9}}, {5, {5}}};
  KeepLatest(max_count, &Entry::seen_at, &entries);
  std::map<int, int> kept;
  for (const auto& [key, entry] : entries) kept[key] = entry.seen_at;
  return kept;
}

TEST(KeepLatest, TheEarliestGoAndOfThoseTheLeastKeys) {
  EXPECT_THAT(Kept(3), ElementsAre(Pair(1, 7), Pair(4, 9), Pair(5, 5)));
  EXPECT_THAT(Kept(1), ElementsAre(Pair(4, 9)));
  EXPECT_THAT(Kept(0), ElementsAre());
}

TEST(KeepLatest, FewEntriesAllStay) {
  EXPECT_EQ(Kept(5).size(), 5u);
  EXPECT_EQ(Kept(6).size(), 5u);
}

}  // namespace
}  // namespace portolan
