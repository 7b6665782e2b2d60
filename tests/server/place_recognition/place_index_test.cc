#include "server/place_recognition/place_index.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "server/place_recognition/inverted_file.h"
#include "server/place_recognition/locality_words.h"
#include "server/place_recognition/posting_pool.h"

namespace portolan {
namespace {

Descriptor RandomDescriptor(std::mt19937_64* random) {
  Descriptor descriptor;
  for (uint64_t& word : descriptor.words) word = (*random)();
  return descriptor;
}

Descriptor Disturbed(Descriptor descriptor, int bits, std::mt19937_64* random) {
  for (int i = 0; i < bits; ++i) {
    const uint64_t bit = (*random)() % 256;
    descriptor.words[bit / 64] ^= uint64_t{1} << (bit % 64);
  }
  return descriptor;
}

// One described keyframe with `count` features on tracks of their own.
Submap RandomPlace(uint64_t seed, int count = 200) {
  std::mt19937_64 random(seed);
  Submap submap;
  submap.keyframes.resize(1);
  for (int i = 0; i < count; ++i) {
    Feature feature;
    feature.track = TrackId(i);
    feature.descriptor = RandomDescriptor(&random);
    submap.keyframes[0].features.push_back(feature);
  }
  return submap;
}

std::shared_ptr<const Submap> Shared(Submap submap) {
  return std::make_shared<const Submap>(std::move(submap));
}

// The same place again: a share of its features, disturbed, the rest new.
Submap Revisit(const Submap& place, double share, int noise_bits, uint64_t seed) {
  std::mt19937_64 random(seed);
  Submap submap = place;
  for (Feature& feature : submap.keyframes[0].features) {
    const bool common = static_cast<double>(random() % 1000) < 1000 * share;
    feature.descriptor =
        common ? Disturbed(feature.descriptor, noise_bits, &random) : RandomDescriptor(&random);
  }
  return submap;
}

std::unique_ptr<PlaceIndex> MakeIndex(PlaceIndexOptions options = {}) {
  auto index = PlaceIndex::Create(options);
  EXPECT_TRUE(index.ok());
  return *std::move(index);
}

TEST(PlaceIndex, FindsTheRevisitedPlaceAmongMany) {
  const auto index = MakeIndex();
  for (int i = 0; i < 300; ++i) index->Add(SubmapId(i), Shared(RandomPlace(i)));
  for (int i = 0; i < 300; i += 17) {
    const auto found = index->Query(Revisit(RandomPlace(i), 0.3, 35, 1000 + i), 5, {});
    ASSERT_FALSE(found.empty());
    EXPECT_EQ(found[0].submap, SubmapId(i));
    EXPECT_TRUE(std::is_sorted(found.begin(), found.end(),
                               [](const auto& a, const auto& b) { return a.score > b.score; }));
  }
}

TEST(PlaceIndex, ShortlistFindsWhatExhaustiveSearchFinds) {
  PlaceIndexOptions exhaustive;
  exhaustive.shortlist = 1000;
  const auto exact = MakeIndex(exhaustive), fast = MakeIndex();
  for (int i = 0; i < 200; ++i) {
    exact->Add(SubmapId(i), Shared(RandomPlace(i)));
    fast->Add(SubmapId(i), Shared(RandomPlace(i)));
  }
  for (int i = 0; i < 40; ++i) {
    const Submap query = Revisit(RandomPlace(i), 0.4, 40, 2000 + i);
    EXPECT_EQ(fast->Query(query, 1, {})[0].submap, exact->Query(query, 1, {})[0].submap);
  }
}

TEST(PlaceIndex, OnlyAdmissibleSubmapsAreFound) {
  const auto index = MakeIndex();
  for (int i = 0; i < 50; ++i) index->Add(SubmapId(i), Shared(RandomPlace(i % 25)));
  const auto found = index->Query(RandomPlace(3), 5, [](SubmapId id) { return id != SubmapId(3); });
  ASSERT_FALSE(found.empty());
  EXPECT_EQ(found[0].submap, SubmapId(28));
  EXPECT_TRUE(index->Query(RandomPlace(3), 5, [](SubmapId) { return false; }).empty());
  EXPECT_TRUE(index->Query(RandomPlace(3), 0, {}).empty());
}

TEST(PlaceIndex, RemovedSubmapsAreForgottenAndReplacedOnesReplaced) {
  const auto index = MakeIndex();
  for (int i = 0; i < 40; ++i) index->Add(SubmapId(i), Shared(RandomPlace(i)));
  index->Remove(SubmapId(7));
  index->Remove(SubmapId(7));
  index->Remove(SubmapId(999));
  EXPECT_EQ(index->submap_count(), 39);
  for (const PlaceCandidate& c : index->Query(RandomPlace(7), 40, {})) {
    EXPECT_NE(c.submap, SubmapId(7));
  }
  index->Add(SubmapId(8), Shared(RandomPlace(500)));
  EXPECT_EQ(index->submap_count(), 39);
  EXPECT_EQ(index->Query(RandomPlace(500), 1, {})[0].submap, SubmapId(8));
}

TEST(PlaceIndex, AnswerDoesNotDependOnTheOrderOfAdding) {
  const auto forward = MakeIndex(), backward = MakeIndex();
  for (int i = 0; i < 100; ++i) forward->Add(SubmapId(i), Shared(RandomPlace(i)));
  backward->Add(SubmapId(1000), Shared(RandomPlace(1000)));
  for (int i = 99; i >= 0; --i) backward->Add(SubmapId(i), Shared(RandomPlace(i)));
  backward->Remove(SubmapId(1000));
  for (int i = 0; i < 100; i += 9) {
    const Submap query = Revisit(RandomPlace(i), 0.5, 40, i);
    const auto a = forward->Query(query, 10, {}), b = backward->Query(query, 10, {});
    ASSERT_EQ(a.size(), b.size());
    for (size_t k = 0; k < a.size(); ++k) {
      EXPECT_EQ(a[k].submap, b[k].submap);
      EXPECT_EQ(a[k].score, b[k].score);
    }
  }
}

// One feature a hundred times over must not outweigh thirty different ones.
TEST(PlaceIndex, RepeatedFeaturesCountOnce) {
  const auto index = MakeIndex();
  const Submap place = RandomPlace(1);
  Submap bursty = RandomPlace(2);
  for (int i = 0; i < 100; ++i) {
    bursty.keyframes[0].features[i].descriptor = place.keyframes[0].features[0].descriptor;
  }
  for (int i = 10; i < 60; ++i) index->Add(SubmapId(i), Shared(RandomPlace(i)));
  index->Add(SubmapId(2), Shared(bursty));
  index->Add(SubmapId(3), Shared(Revisit(place, 0.15, 10, 5)));
  EXPECT_EQ(index->Query(place, 1, {})[0].submap, SubmapId(3));
}

TEST(PlaceIndex, EmptyAndHugeSubmapsAreLegal) {
  const auto index = MakeIndex();
  EXPECT_TRUE(index->Query(RandomPlace(1), 5, {}).empty());
  index->Add(SubmapId(1), Shared(Submap()));
  index->Add(SubmapId(2), Shared(RandomPlace(2, 20000)));
  EXPECT_TRUE(index->Query(Submap(), 5, {}).empty());
  EXPECT_EQ(index->Query(RandomPlace(2, 20000), 5, {})[0].submap, SubmapId(2));
  index->Remove(SubmapId(1));
  EXPECT_EQ(index->submap_count(), 1);
}

TEST(PlaceIndexOptions, RefusesNonsense) {
  PlaceIndexOptions options;
  options.bits_per_word = 40;
  EXPECT_FALSE(PlaceIndex::Create(options).ok());
  options = {};
  options.falloff_bits = 0;
  EXPECT_FALSE(PlaceIndex::Create(options).ok());
}

TEST(LocalityWords, EqualDescriptorsShareAllWordsAndTablesNone) {
  std::mt19937_64 random(1);
  const LocalityWords words(12, 20);
  const Descriptor descriptor = RandomDescriptor(&random);
  std::vector<uint32_t> first, second;
  words.AppendWords(descriptor, &first);
  LocalityWords(12, 20).AppendWords(descriptor, &second);
  EXPECT_EQ(first, second);
  std::sort(first.begin(), first.end());
  EXPECT_EQ(std::unique(first.begin(), first.end()) - first.begin(), 12);
}

// (1 - d / 256)^bits words are shared.
TEST(LocalityWords, SharedWordsFallOffWithTheDistance) {
  std::mt19937_64 random(2);
  const LocalityWords words(12, 10);
  int shared = 0;
  const int count = 2000;
  for (int i = 0; i < count; ++i) {
    const Descriptor a = RandomDescriptor(&random);
    Descriptor b = a;
    for (int bit = 0; bit < 32; ++bit) b.words[bit % 4] ^= uint64_t{1} << (2 * bit + i) % 64;
    const double distance = HammingDistance(a, b);
    ASSERT_GT(distance, 0);
    std::vector<uint32_t> of_a, of_b;
    words.AppendWords(a, &of_a);
    words.AppendWords(b, &of_b);
    for (int t = 0; t < 12; ++t) shared += of_a[t] == of_b[t];
  }
  EXPECT_NEAR(shared / (12.0 * count), std::pow(1 - 32 / 256.0, 10), 0.06);
}

TEST(InvertedFile, RareWordsWeighMoreAndCommonOnesNothing) {
  InvertedFile file(1000);
  for (uint32_t slot = 0; slot < 40; ++slot) file.Add(slot, {1, 100 + slot, 200 + slot / 2});
  const auto votes = file.Vote({1, 105, 202}, 0.3);
  EXPECT_GT(votes[5], votes[4]);
  EXPECT_GT(votes[4], 0u);
  EXPECT_EQ(votes[7], 0u);  // word 1 is in all of them
  file.Remove(5, {1, 105, 202});
  EXPECT_EQ(file.Vote({105}, 0.3)[5], 0u);
}

// Against a list of lists, by turns at random.
TEST(PostingPool, ListsKeepWhatIsAddedAndNotTakenOut) {
  std::mt19937 random(3);
  PostingPool pool;
  std::vector<PostingList> lists(40);
  std::vector<std::vector<uint32_t>> expected(lists.size());
  for (uint32_t number = 0; number < 40000; ++number) {
    // The lists grow, shrink to nothing, and grow again; high ones are longer.
    const size_t i = std::max(random() % lists.size(), random() % lists.size());
    const bool grows = random() % 10 < ((number / 10000) % 2 == 0 ? 7u : 2u);
    if (grows) {
      pool.Append(number, &lists[i]);
      expected[i].push_back(number);
    } else if (!expected[i].empty()) {
      const size_t k = random() % expected[i].size();
      pool.Remove(expected[i][k], &lists[i]);
      expected[i].erase(expected[i].begin() + static_cast<std::ptrdiff_t>(k));
    }
    pool.Remove(number + 1, &lists[i]);  // is not there
    ASSERT_EQ(lists[i].length, expected[i].size());
    if (number % 500 != 0) continue;
    for (size_t k = 0; k < lists.size(); ++k) {
      EXPECT_THAT(pool.Numbers(lists[k]), testing::UnorderedElementsAreArray(expected[k]));
    }
  }
}

TEST(PostingPool, AListMayBeLongerThanASegment) {
  PostingPool pool;
  std::vector<PostingList> lists(3);
  constexpr uint32_t kCount = 200000;
  for (uint32_t number = 0; number < kCount; ++number) {
    for (uint32_t i = 0; i < 3; ++i) pool.Append(3 * number + i, &lists[i]);
  }
  pool.Remove(3 * 1000 + 1, &lists[1]);
  for (uint32_t i = 0; i < 3; ++i) {
    const auto numbers = pool.Numbers(lists[i]);
    ASSERT_EQ(numbers.size(), i == 1 ? kCount - 1 : kCount);
    for (uint32_t k = 0; k < numbers.size(); ++k) {
      const uint32_t expected = i == 1 && k == 1000 ? kCount - 1 : k;
      ASSERT_EQ(numbers[k], 3 * expected + i);
    }
  }
}

// With few words to be told apart its map becomes a table on the way.
TEST(InvertedFile, VotesAreTheSameHoweverManyWordsThereMayBe) {
  constexpr uint32_t kWords = 200;
  std::mt19937 random(5);
  std::vector<std::vector<uint32_t>> documents(150);
  for (auto& words : documents) {
    for (uint32_t word = 0; word < kWords; ++word) {
      if (random() % 20 == 0) words.push_back(word);
    }
  }
  InvertedFile crowded(kWords);
  InvertedFile sparse(1u << 20);
  const auto expect_same = [&] {
    for (const auto& words : documents) EXPECT_EQ(crowded.Vote(words, 1), sparse.Vote(words, 1));
  };
  for (uint32_t slot = 0; slot < documents.size(); ++slot) {
    crowded.Add(slot, documents[slot]);
    sparse.Add(slot, documents[slot]);
  }
  expect_same();
  for (uint32_t slot = 0; slot < documents.size(); slot += 2) {
    crowded.Remove(slot, documents[slot]);
    sparse.Remove(slot, documents[slot]);
  }
  expect_same();
  // Everything goes and comes again.
  for (uint32_t slot = 1; slot < documents.size(); slot += 2) {
    crowded.Remove(slot, documents[slot]);
    sparse.Remove(slot, documents[slot]);
  }
  EXPECT_EQ(crowded.Vote(documents[0], 1), std::vector<uint32_t>(documents.size(), 0));
  crowded.Add(7, documents[7]);
  sparse.Add(7, documents[7]);
  expect_same();
}

}  // namespace
}  // namespace portolan
