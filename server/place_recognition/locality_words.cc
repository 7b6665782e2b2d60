#include "server/place_recognition/locality_words.h"

#include <numeric>
#include <random>
#include <utility>

#include "common/base/check.h"

namespace portolan {
namespace {

constexpr int kMaxBitsPerWord = 24;
constexpr int kMaxTables = 32;

// A permutation of 0..255; std::shuffle is not the same in every library, this is.
std::vector<uint8_t> ShuffledBits(std::mt19937* random) {
  std::vector<uint8_t> bits(256);
  std::iota(bits.begin(), bits.end(), uint8_t{0});
  for (size_t i = 255; i > 0; --i) std::swap(bits[i], bits[(*random)() % (i + 1)]);
  return bits;
}

}  // namespace

LocalityWords::LocalityWords(int tables, int bits_per_word) : bits_per_word_(bits_per_word) {
  PORTOLAN_CHECK(bits_per_word >= 1 && bits_per_word <= kMaxBitsPerWord);
  PORTOLAN_CHECK(tables >= 1 && tables <= kMaxTables);
  // Words use up one permutation before the next begins, so that bits are shared by as few words
  // as possible.
  std::mt19937 random(20071);
  std::vector<uint8_t> unused;
  for (int table = 0; table < tables; ++table) {
    if (static_cast<int>(unused.size()) < bits_per_word) unused = ShuffledBits(&random);
    bits_.insert(bits_.end(), unused.end() - bits_per_word, unused.end());
    unused.erase(unused.end() - bits_per_word, unused.end());
  }
}

void LocalityWords::AppendWords(const Descriptor& descriptor, std::vector<uint32_t>* words) const {
  const size_t tables = bits_.size() / bits_per_word_;
  const uint8_t* bit = bits_.data();
  for (size_t table = 0; table < tables; ++table) {
    uint32_t word = static_cast<uint32_t>(table);
    for (int i = 0; i < bits_per_word_; ++i, ++bit) {
      word = (word << 1) | ((descriptor.words[*bit >> 6] >> (*bit & 63)) & 1);
    }
    words->push_back(word);
  }
}

}  // namespace portolan
