#include "common/base/time.h"

#include "gtest/gtest.h"

namespace portolan {
namespace {

TEST(Time, SecondsRoundToTheNearestNanosecond) {
  EXPECT_EQ(FromSeconds(0.1).count(), 100000000);
  EXPECT_EQ(FromSeconds(-1.5).count(), -1500000000);
  EXPECT_DOUBLE_EQ(ToSeconds(Duration(2500000000)), 2.5);
}

}  // namespace
}  // namespace portolan
