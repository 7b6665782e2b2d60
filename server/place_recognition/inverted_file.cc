#include "server/place_recognition/inverted_file.h"

#include <algorithm>
#include <cmath>

namespace portolan {
namespace {

// Words with no more documents than this are used however small the map is.
constexpr size_t kAlwaysUsedPostings = 30;

// Share of the words at which the hash map is given up: a little later, at 7/16 of a power of two,
// it would double, to 13 bytes a word; a table takes 8.
constexpr double kCrowded = 0.4;

}  // namespace

InvertedFile::InvertedFile(uint32_t word_count) : word_count_(word_count) {}

const PostingList* InvertedFile::Find(uint32_t word) const {
  if (!list_table_.empty()) {
    return list_table_[word].length == 0 ? nullptr : &list_table_[word];
  }
  const auto found = lists_.find(word);
  return found == lists_.end() ? nullptr : &found->second;
}

PostingList& InvertedFile::FindOrAdd(uint32_t word) {
  if (list_table_.empty()) {
    if (static_cast<double>(lists_.size()) < kCrowded * word_count_) {
      return lists_.try_emplace(word).first->second;
    }
    list_table_.assign(word_count_, {});
    for (const auto& [known, list] : lists_) list_table_[known] = list;
    absl::flat_hash_map<uint32_t, PostingList>().swap(lists_);
  }
  return list_table_[word];
}

void InvertedFile::Erase(uint32_t word) {
  if (list_table_.empty()) lists_.erase(word);
}

void InvertedFile::Add(uint32_t slot, const std::vector<uint32_t>& words) {
  for (const uint32_t word : words) pool_.Append(slot, &FindOrAdd(word));
  slot_end_ = std::max(slot_end_, slot + 1);
  ++document_count_;
}

void InvertedFile::Remove(uint32_t slot, const std::vector<uint32_t>& words) {
  for (const uint32_t word : words) {
    PostingList* list = Find(word);
    if (list == nullptr) continue;
    pool_.Remove(slot, list);
    if (list->length == 0) Erase(word);
  }
  --document_count_;
}

std::vector<uint32_t> InvertedFile::Vote(const std::vector<uint32_t>& words,
                                         double max_frequency) const {
  std::vector<uint32_t> votes(slot_end_, 0);
  const size_t longest =
      std::max<size_t>(kAlwaysUsedPostings, static_cast<size_t>(max_frequency * document_count_));
  for (const uint32_t word : words) {
    const PostingList* list = Find(word);
    if (list == nullptr || list->length > longest) continue;
    // One more document than there is, so that a word of the only document still counts.
    const double idf = std::log((document_count_ + 1.0) / list->length);
    const auto weight = static_cast<uint32_t>(std::lround(256.0 * idf));
    for (const uint32_t slot : pool_.Numbers(*list)) votes[slot] += weight;
  }
  return votes;
}

}  // namespace portolan
