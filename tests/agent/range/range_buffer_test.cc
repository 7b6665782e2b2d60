#include "agent/range/range_buffer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

namespace portolan {
namespace {

using std::chrono::milliseconds;

RangeSample At(int time_ms, double range_m, double sigma_m = 0) {
  return {milliseconds(time_ms), range_m, sigma_m};
}

class RangeBufferTest : public testing::Test {
 protected:
  void Add(const RangeSample& sample) { buffer_.Add({{sample}}); }

  RangeBuffer buffer_{RangeFinder{{0, 0, 0}, {0, 0, 1}, 0.02, 0.5, 40}};
};

TEST_F(RangeBufferTest, GivesTheNewestSampleOfAnImageOnce) {
  Add(At(10, 3));
  Add(At(40, 4));
  const auto sample = buffer_.Take(milliseconds(50), milliseconds(20));
  ASSERT_TRUE(sample);
  EXPECT_EQ(sample->range_m, 4);
  EXPECT_EQ(sample->sigma_m, 0.02);
  EXPECT_FALSE(buffer_.Take(milliseconds(60), milliseconds(100)));
}

TEST_F(RangeBufferTest, ASampleMayHaveItsOwnSigma) {
  Add(At(10, 3, 0.5));
  EXPECT_EQ(buffer_.Take(milliseconds(10), milliseconds(20))->sigma_m, 0.5);
}

TEST_F(RangeBufferTest, NeitherOldNorFutureSamplesBelongToAnImage) {
  Add(At(10, 3));
  EXPECT_FALSE(buffer_.Take(milliseconds(9), milliseconds(20)));
  EXPECT_FALSE(buffer_.Take(milliseconds(31), milliseconds(20)));
}

TEST_F(RangeBufferTest, DamagedSamplesAreCountedByKind) {
  Add(At(100, 3));
  Add(At(110, std::numeric_limits<double>::quiet_NaN()));
  Add(At(110, 3, std::numeric_limits<double>::infinity()));
  Add(At(110, 3, -1));
  Add(At(100, 3));
  Add(At(20, 3));
  int time_ms = 200;
  for (const double range : {0.0, -1.0, 0.49, 40.1}) Add(At(time_ms += 10, range));
  EXPECT_EQ(buffer_.counts().accepted, 1);
  EXPECT_EQ(buffer_.counts().not_finite, 3);
  EXPECT_EQ(buffer_.counts().out_of_order, 2);
  EXPECT_EQ(buffer_.counts().no_echo, 4);
  EXPECT_EQ(buffer_.Take(milliseconds(700), milliseconds(700))->time, milliseconds(100));
}

}  // namespace
}  // namespace portolan
