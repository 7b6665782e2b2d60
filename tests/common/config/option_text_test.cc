#include "common/config/option_text.h"

#include <limits>

#include "tests/support/matchers.h"

namespace portolan {
namespace {

template <typename T>
void ExpectRoundTrip(T value) {
  T back{};
  ASSERT_THAT(ParseOptionText(OptionTextOf(value), &back), IsOk());
  EXPECT_EQ(back, value);
}

TEST(OptionText, TextReadsBackAsTheSameValue) {
  ExpectRoundTrip(true);
  ExpectRoundTrip(std::numeric_limits<int32_t>::min());
  ExpectRoundTrip(std::numeric_limits<uint64_t>::max());
  ExpectRoundTrip(0.1);
  ExpectRoundTrip(1.0 / 3.0);
  ExpectRoundTrip(0.3f);
  ExpectRoundTrip(std::string("a b"));
  ExpectRoundTrip(Duration(1500000000));
}

TEST(OptionText, ShortestTextIsUsed) {
  EXPECT_EQ(OptionTextOf(0.1), "0.1");
  EXPECT_EQ(OptionTextOf(0.1f), "0.1");
  EXPECT_EQ(OptionTextOf(Duration(250000000)), "0.25");
}

template <typename T>
bool Parses(const std::string& text) {
  T value{};
  return ParseOptionText(text, &value).ok();
}

TEST(OptionText, RefusesWhatIsNotWhollyAValue) {
  EXPECT_FALSE(Parses<int32_t>("3x"));
  EXPECT_FALSE(Parses<int32_t>("3000000000"));
  EXPECT_FALSE(Parses<uint32_t>("-1"));
  EXPECT_FALSE(Parses<double>("nan"));
  EXPECT_FALSE(Parses<double>("1e999"));
  EXPECT_FALSE(Parses<double>(""));
  EXPECT_FALSE(Parses<bool>("yes"));
  EXPECT_FALSE(Parses<Duration>("1e12"));
}

TEST(OptionText, EditDistanceCountsEdits) {
  EXPECT_EQ(EditDistance("kitten", "sitting"), 3);
  EXPECT_EQ(EditDistance("", "abc"), 3);
  EXPECT_EQ(EditDistance("same", "same"), 0);
}

}  // namespace
}  // namespace portolan
