#include "agent/range/scale_finder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/matchers.h"

namespace portolan {
namespace {

class ScaleFinderTest : public testing::Test {
 protected:
  void Add(double time_s, double log_scale, double own = 1e-4, double shared = 1e-6) {
    finder_.Add({FromSeconds(time_s), log_scale, own, shared});
  }

  ScaleFinder finder_{{}};
};

TEST_F(ScaleFinderTest, NeedsSeveral) {
  for (int i = 0; i < 4; ++i) Add(0.1 * i, 1);
  EXPECT_FALSE(finder_.Find());
  Add(0.4, 1.01);
  ASSERT_TRUE(finder_.Find());
  EXPECT_NEAR(finder_.Find()->log_scale, 1.002, 1e-12);
  finder_.Reset();
  EXPECT_FALSE(finder_.Find());
}

TEST_F(ScaleFinderTest, OwnErrorsAverageOutSharedOnesDoNot) {
  for (int i = 0; i < 16; ++i) Add(0.1 * i, 1, 4e-4, 0);
  EXPECT_NEAR(finder_.Find()->sigma, 0.02 / 4, 1e-12);
  finder_.Reset();
  for (int i = 0; i < 16; ++i) Add(0.1 * i, 1, 1e-12, 4e-4);
  EXPECT_NEAR(finder_.Find()->sigma, 0.02, 1e-6);
}

TEST_F(ScaleFinderTest, AFewThatDisagreeDoNotCount) {
  for (int i = 0; i < 8; ++i) Add(0.1 * i, i % 4 == 3 ? 1.7 : 1);
  ASSERT_TRUE(finder_.Find());
  EXPECT_NEAR(finder_.Find()->log_scale, 1, 1e-12);
}

TEST_F(ScaleFinderTest, ManyThatDisagreeTellNothing) {
  for (int i = 0; i < 12; ++i) Add(0.1 * i, 0.2 * i);
  EXPECT_FALSE(finder_.Find());
}

TEST_F(ScaleFinderTest, PoorOnesTellNothing) {
  for (int i = 0; i < 5; ++i) Add(0.1 * i, 1, 1e-4, 0.04);
  EXPECT_FALSE(finder_.Find());
}

TEST_F(ScaleFinderTest, OldOnesAreForgotten) {
  for (int i = 0; i < 10; ++i) Add(0.1 * i, 1);
  Add(100, 1);
  EXPECT_FALSE(finder_.Find());
}

TEST(ScaleFinderOptions, AreChecked) {
  EXPECT_THAT(ScaleFinderOptions().Validate(), IsOk());
  EXPECT_FALSE(ScaleFinderOptions{.min_ranges = 2}.Validate().ok());
  EXPECT_FALSE(ScaleFinderOptions{.min_agreeing_share = 0.5}.Validate().ok());
  EXPECT_FALSE(ScaleFinderOptions{.max_log_scale_sigma = std::nan("")}.Validate().ok());
  EXPECT_FALSE(ScaleFinderOptions{.window_s = 0}.Validate().ok());
}

}  // namespace
}  // namespace portolan
