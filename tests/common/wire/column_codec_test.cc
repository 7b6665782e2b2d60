#include "common/wire/column_codec.h"

#include <random>

#include "tests/support/matchers.h"

namespace portolan {
namespace {

using testing::HasSubstr;

TEST(ColumnCodec, KeepsAnyIntegers) {
  const std::vector<int64_t> values = {0,         -1,        1,  1000, -100000, INT64_MAX,
                                       INT64_MIN, INT64_MAX, -7, 0,    1 << 30, 3};
  const auto decoded = DecodeColumn(EncodeColumn(values), values.size());
  ASSERT_THAT(decoded, IsOk());
  EXPECT_EQ(*decoded, values);
}

TEST(ColumnCodec, IsEmptyForNoIntegers) {
  EXPECT_TRUE(EncodeColumn({}).empty());
  const auto decoded = DecodeColumn("", 0);
  ASSERT_THAT(decoded, IsOk());
  EXPECT_TRUE(decoded->empty());
}

TEST(ColumnCodec, KeepsRandomColumnsOfEveryMagnitude) {
  std::mt19937_64 random(7);
  for (int bits = 0; bits < 63; ++bits) {
    std::uniform_int_distribution<int64_t> value(-(int64_t{1} << bits), int64_t{1} << bits);
    std::vector<int64_t> values(300);
    for (auto& v : values) v = value(random);
    const auto decoded = DecodeColumn(EncodeColumn(values), values.size());
    ASSERT_THAT(decoded, IsOk());
    EXPECT_EQ(*decoded, values) << bits;
  }
}

TEST(ColumnCodec, TakesAboutTheEntropyOfGaussianValues) {
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal(0, 100);
  std::vector<int64_t> values(10000);
  for (auto& v : values) v = std::llround(normal(random));
  // Entropy of a rounded Gaussian: log2(sigma sqrt(2 pi e)) = 8.69 bits.
  EXPECT_LT(8.0 * static_cast<double>(EncodeColumn(values).size()) / 10000, 9.3);
}

TEST(ColumnCodec, MatchesTheDocumentedBits) {
  // u = 2 with k = 4: 0 0010; then count 2, sum 18, k = 4, u = 1: 0 0001; padding 000000.
  const std::string bytes = EncodeColumn({1, -1});
  ASSERT_EQ(bytes.size(), 2u);
  EXPECT_EQ(static_cast<unsigned char>(bytes[0]), 0b00010000);
  EXPECT_EQ(static_cast<unsigned char>(bytes[1]), 0b01000000);
}

TEST(ColumnCodec, RefusesTruncatedBytes) {
  const std::string bytes = EncodeColumn({1000, 2000, -3000, 4000});
  for (size_t size = 0; size < bytes.size(); ++size) {
    EXPECT_THAT(DecodeColumn(std::string_view(bytes).substr(0, size), 4),
                StatusIs(absl::StatusCode::kInvalidArgument))
        << size;
  }
}

TEST(ColumnCodec, RefusesSurplusBytes) {
  EXPECT_THAT(DecodeColumn(EncodeColumn({1, 2}) + '\0', 2),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("after")));
}

TEST(ColumnCodec, RefusesMoreIntegersThanBitsBeforeAllocating) {
  EXPECT_THAT(DecodeColumn("ab", size_t{1} << 60),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("cannot hold")));
}

}  // namespace
}  // namespace portolan
