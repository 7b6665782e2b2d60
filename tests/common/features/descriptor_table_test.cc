#include "common/features/descriptor_table.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

namespace portolan {
namespace {

Descriptor RandomDescriptor(std::mt19937_64* random) {
  Descriptor descriptor;
  for (uint64_t& word : descriptor.words) word = (*random)();
  return descriptor;
}

TEST(HammingDistance, CountsBitsOfAllWords) {
  Descriptor a;
  Descriptor b;
  EXPECT_EQ(HammingDistance(a, b), 0);
  b.words = {1, 3, 7, ~uint64_t{0}};
  EXPECT_EQ(HammingDistance(a, b), 1 + 2 + 3 + 64);
  for (uint64_t& word : a.words) word = ~uint64_t{0};
  EXPECT_EQ(HammingDistance(a, Descriptor{}), 256);
}

// Sizes around the width of the vector unit, so that remainders are covered.
TEST(DescriptorTable, DistancesEqualTheScalarOnes) {
  std::mt19937_64 random(1);
  for (size_t count : {0, 1, 7, 8, 9, 31, 64, 100}) {
    DescriptorTable table;
    std::vector<Descriptor> expected;
    for (size_t i = 0; i < count; ++i) {
      expected.push_back(RandomDescriptor(&random));
      table.Append(expected.back());
    }
    const Descriptor query = RandomDescriptor(&random);
    std::vector<uint32_t> distances = {99, 99};
    table.Distances(query, &distances);
    ASSERT_EQ(distances.size(), count);
    for (size_t i = 0; i < count; ++i) {
      EXPECT_EQ(static_cast<int>(distances[i]), HammingDistance(query, expected[i]));
      EXPECT_EQ(table[i], expected[i]);
    }
    const DescriptorTable::Neighbour nearest = table.Nearest(query);
    const auto first = std::min_element(distances.begin(), distances.end());
    EXPECT_EQ(nearest.distance_bits, count == 0 ? 257u : *first);
    EXPECT_EQ(nearest.index, count == 0 ? 0u : static_cast<uint32_t>(first - distances.begin()));
  }
}

TEST(DescriptorTable, NearestOfEqualsIsTheFirst) {
  DescriptorTable table;
  for (int i = 0; i < 20; ++i) table.Append(Descriptor{});
  EXPECT_EQ(table.Nearest(Descriptor{}).index, 0u);
  EXPECT_EQ(table.Nearest(Descriptor{}).distance_bits, 0u);
}

}  // namespace
}  // namespace portolan
