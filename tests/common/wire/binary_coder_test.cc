#include "common/wire/binary_coder.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

namespace portolan {
namespace {

struct Decision {
  bool bit;
  uint32_t one_q16;
};

// Bits that come as often as their probability says, or as it says of the opposite.
std::vector<Decision> RandomDecisions(size_t count, uint32_t seed, bool lying) {
  std::mt19937 random(seed);
  std::vector<Decision> decisions;
  for (size_t i = 0; i < count; ++i) {
    const uint32_t one_q16 = 1 + static_cast<uint32_t>(random() % 65535);
    decisions.push_back({((random() & 0xffff) < one_q16) != lying, one_q16});
  }
  return decisions;
}

std::string Encode(const std::vector<Decision>& decisions) {
  BinaryEncoder encoder;
  for (const Decision& d : decisions) encoder.Encode(d.bit, d.one_q16);
  return encoder.Take();
}

// True if the stream gives these bits and ends with them.
bool Holds(std::string_view bytes, const std::vector<Decision>& decisions) {
  BinaryDecoder decoder(bytes);
  for (const Decision& d : decisions) {
    if (decoder.Decode(d.one_q16) != d.bit) return false;
  }
  return !decoder.PastEnd() && decoder.AtEnd();
}

TEST(BinaryCoder, GivesBackWhatWasWritten) {
  for (size_t count = 0; count < 200; ++count) {
    for (const bool lying : {false, true}) {
      const auto decisions = RandomDecisions(count, static_cast<uint32_t>(count), lying);
      EXPECT_TRUE(Holds(Encode(decisions), decisions)) << count;
    }
  }
}

TEST(BinaryCoder, GivesBackExtremes) {
  for (const uint32_t one_q16 : {1u, 65535u}) {
    for (const bool bit : {false, true}) {
      const std::vector<Decision> decisions(5000, {bit, one_q16});
      EXPECT_TRUE(Holds(Encode(decisions), decisions)) << one_q16 << bit;
    }
  }
}

TEST(BinaryCoder, TakesTheEntropyAndLittleMore) {
  const auto decisions = RandomDecisions(100'000, 3, false);
  double bits = 0;
  for (const Decision& d : decisions) {
    const double p = d.one_q16 / 65536.0;
    bits -= std::log2(d.bit ? p : 1 - p);
  }
  EXPECT_LT(static_cast<double>(Encode(decisions).size()), bits / 8 * 1.001 + 2);
}

TEST(BinaryCoder, NothingTakesNoBytes) {
  EXPECT_EQ(BinaryEncoder().Take(), "");
  EXPECT_TRUE(BinaryDecoder("").AtEnd());
  EXPECT_FALSE(BinaryDecoder("x").AtEnd());
}

TEST(BinaryCoder, AnotherEndIsNoticed) {
  const auto decisions = RandomDecisions(500, 4, false);
  const std::string bytes = Encode(decisions);
  for (size_t size = 0; size < bytes.size(); ++size) {
    EXPECT_FALSE(Holds(std::string_view(bytes).substr(0, size), decisions)) << size;
  }
  EXPECT_FALSE(Holds(bytes + '\0', decisions));
}

TEST(BinaryCoder, TakeStartsAnew) {
  const auto decisions = RandomDecisions(50, 5, false);
  BinaryEncoder encoder;
  for (int round = 0; round < 2; ++round) {
    for (const Decision& d : decisions) encoder.Encode(d.bit, d.one_q16);
    EXPECT_TRUE(Holds(encoder.Take(), decisions));
  }
}

}  // namespace
}  // namespace portolan
