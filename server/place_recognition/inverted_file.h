// Inverted file from words to the documents that hold them, with idf-weighted voting (Sivic &
// Zisserman, "Video Google", ICCV 2003).
#ifndef PORTOLAN_SERVER_PLACE_RECOGNITION_INVERTED_FILE_H_
#define PORTOLAN_SERVER_PLACE_RECOGNITION_INVERTED_FILE_H_

#include <cstdint>
#include <deque>
#include <vector>

#include "absl/container/flat_hash_map.h"

namespace portolan {

// A document is a small number (slot) and a set of words: a word counts once in a document and
// once in a query, however often it occurs, which is the remedy for repeated structures
// ("burstiness", Jegou, Douze, Schmid, CVPR 2009).
// Thread rule: thread-compatible.
class InvertedFile {
 public:
  // Words are less than word_count.
  explicit InvertedFile(uint32_t word_count);

  // `words` ascending, without repetition; the slot holds no document yet.
  void Add(uint32_t slot, const std::vector<uint32_t>& words);
  // `words` as given to Add.
  void Remove(uint32_t slot, const std::vector<uint32_t>& words);

  // votes[slot] = sum over the common words of round(256 * log(documents / frequency of the
  // word)), without the words that more than max_frequency * documents (and more than 30) hold.
  // Integers, so that the sum does not depend on an order. Slots that hold nothing get 0.
  std::vector<uint32_t> Vote(const std::vector<uint32_t>& words, double max_frequency) const;

 private:
  // The documents of a word are a chain in one pool: most words are in one or two documents, and a
  // container a word would take several times their room.
  struct Posting {
    uint32_t slot;
    uint32_t next;  // in the pool
  };
  static constexpr uint32_t kEnd = UINT32_MAX;
  struct Chain {
    uint32_t first = kEnd;
    uint32_t length = 0;
  };

  // Null if no document has the word.
  const Chain* Find(uint32_t word) const;
  Chain* Find(uint32_t word) {
    return const_cast<Chain*>(static_cast<const InvertedFile*>(this)->Find(word));
  }
  Chain& FindOrAdd(uint32_t word);
  void Erase(uint32_t word);

  const uint32_t word_count_;
  // Of the words that occur; once these are many, a table of all words takes less room, and none
  // twice when it grows.
  absl::flat_hash_map<uint32_t, Chain> chains_;
  std::vector<Chain> chain_table_;
  std::deque<Posting> pool_;
  uint32_t first_free_;  // chain of unused postings
  uint32_t slot_end_ = 0;
  int document_count_ = 0;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_PLACE_RECOGNITION_INVERTED_FILE_H_
