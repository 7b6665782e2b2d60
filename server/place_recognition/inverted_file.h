// Inverted file from words to the documents that hold them, with idf-weighted voting (Sivic &
// Zisserman, "Video Google", ICCV 2003).
#ifndef PORTOLAN_SERVER_PLACE_RECOGNITION_INVERTED_FILE_H_
#define PORTOLAN_SERVER_PLACE_RECOGNITION_INVERTED_FILE_H_

#include <cstdint>
#include <vector>

#include "absl/container/flat_hash_map.h"
#include "server/place_recognition/posting_pool.h"

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
  // Null if no document has the word.
  const PostingList* Find(uint32_t word) const;
  PostingList* Find(uint32_t word) {
    return const_cast<PostingList*>(static_cast<const InvertedFile*>(this)->Find(word));
  }
  PostingList& FindOrAdd(uint32_t word);
  void Erase(uint32_t word);

  const uint32_t word_count_;
  // Of the words that occur; once these are many, a table of all words takes less room, and none
  // twice when it grows.
  absl::flat_hash_map<uint32_t, PostingList> lists_;
  std::vector<PostingList> list_table_;
  PostingPool pool_;
  uint32_t slot_end_ = 0;
  int document_count_ = 0;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_PLACE_RECOGNITION_INVERTED_FILE_H_
