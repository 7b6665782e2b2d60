#include "server/place_recognition/inverted_file.h"

#include <algorithm>
#include <cmath>

namespace portolan {
namespace {

// Words with no more documents than this are used however small the map is.
constexpr size_t kAlwaysUsedPostings = 30;

constexpr uint32_t kEnd = UINT32_MAX;

}  // namespace

InvertedFile::InvertedFile() : first_free_(kEnd) {}

void InvertedFile::Add(uint32_t slot, const std::vector<uint32_t>& words) {
  for (const uint32_t word : words) {
    uint32_t index = first_free_;
    if (index == kEnd) {
      index = static_cast<uint32_t>(pool_.size());
      pool_.emplace_back();
    } else {
      first_free_ = pool_[index].next;
    }
    Chain& chain = chains_.try_emplace(word, Chain{kEnd, 0}).first->second;
    pool_[index] = {slot, chain.first};
    chain = {index, chain.length + 1};
  }
  slot_end_ = std::max(slot_end_, slot + 1);
  ++document_count_;
}

void InvertedFile::Remove(uint32_t slot, const std::vector<uint32_t>& words) {
  for (const uint32_t word : words) {
    const auto it = chains_.find(word);
    if (it == chains_.end()) continue;
    uint32_t* link = &it->second.first;
    while (*link != kEnd && pool_[*link].slot != slot) link = &pool_[*link].next;
    if (*link == kEnd) continue;
    const uint32_t index = *link;
    *link = pool_[index].next;
    pool_[index].next = first_free_;
    first_free_ = index;
    if (--it->second.length == 0) chains_.erase(it);
  }
  --document_count_;
}

std::vector<uint32_t> InvertedFile::Vote(const std::vector<uint32_t>& words,
                                         double max_frequency) const {
  std::vector<uint32_t> votes(slot_end_, 0);
  const size_t longest =
      std::max<size_t>(kAlwaysUsedPostings, static_cast<size_t>(max_frequency * document_count_));
  for (const uint32_t word : words) {
    const auto it = chains_.find(word);
    if (it == chains_.end() || it->second.length > longest) continue;
    // One more document than there is, so that a word of the only document still counts.
    const double idf = std::log((document_count_ + 1.0) / it->second.length);
    const auto weight = static_cast<uint32_t>(std::lround(256.0 * idf));
    for (uint32_t i = it->second.first; i != kEnd; i = pool_[i].next) {
      votes[pool_[i].slot] += weight;
    }
  }
  return votes;
}

}  // namespace portolan
