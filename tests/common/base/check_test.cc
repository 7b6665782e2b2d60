#include "common/base/check.h"

#include "gtest/gtest.h"

namespace portolan {
namespace {

TEST(CheckDeathTest, FailureNamesFileAndCondition) {
  EXPECT_DEATH(PORTOLAN_CHECK(1 + 1 == 3), "check_test.cc:[0-9]+: check failed: 1 \\+ 1 == 3");
}

TEST(Check, TrueConditionIsEvaluatedOnce) {
  int count = 0;
  PORTOLAN_CHECK(++count == 1);
  EXPECT_EQ(count, 1);
}

}  // namespace
}  // namespace portolan
