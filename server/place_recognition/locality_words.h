// Binary words: locality-sensitive hashes of a descriptor by bit sampling (Indyk & Motwani, STOC
// 1998). Two descriptors that differ in a share d of their bits have a word of b bits in common
// with probability (1 - d)^b, so no vocabulary has to be trained, and words never change when the
// map grows.
#ifndef PORTOLAN_SERVER_PLACE_RECOGNITION_LOCALITY_WORDS_H_
#define PORTOLAN_SERVER_PLACE_RECOGNITION_LOCALITY_WORDS_H_

#include <cstdint>
#include <vector>

#include "common/features/descriptor.h"

namespace portolan {

// Thread rule: immutable, thread-safe.
class LocalityWords {
 public:
  // tables * bits_per_word sampled bits; the sample is the same in every process. bits_per_word in
  // 1..24, tables in 1..32.
  LocalityWords(int tables, int bits_per_word);

  // Appends one word a table; words of different tables differ.
  void AppendWords(const Descriptor& descriptor, std::vector<uint32_t>* words) const;
  // Words are less than this.
  uint32_t word_count() const {
    return static_cast<uint32_t>((bits_.size() / bits_per_word_) << bits_per_word_);
  }

 private:
  const int bits_per_word_;
  std::vector<uint8_t> bits_;  // bits_per_word_ consecutive ones a table
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_PLACE_RECOGNITION_LOCALITY_WORDS_H_
