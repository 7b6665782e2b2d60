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

InvertedFile::InvertedFile(uint32_t word_count) : word_count_(word_count), first_free_(kEnd) {}

const InvertedFile::Chain* InvertedFile::Find(uint32_t word) const {
  if (!chain_table_.empty()) {
    return chain_table_[word].length == 0 ? nullptr : &chain_table_[word];
  }
  const auto found = chains_.find(word);
  return found == chains_.end() ? nullptr : &found->second;
}

InvertedFile::Chain& InvertedFile::FindOrAdd(uint32_t word) {
  if (chain_table_.empty()) {
    if (static_cast<double>(chains_.size()) < kCrowded * word_count_) {
      return chains_.try_emplace(word).first->second;
    }
    chain_table_.assign(word_count_, {});
    for (const auto& [known, chain] : chains_) chain_table_[known] = chain;
    absl::flat_hash_map<uint32_t, Chain>().swap(chains_);
  }
  return chain_table_[word];
}

void InvertedFile::Erase(uint32_t word) {
  if (chain_table_.empty()) {
    chains_.erase(word);
  } else {
    chain_table_[word] = {};
  }
}

void InvertedFile::Add(uint32_t slot, const std::vector<uint32_t>& words) {
  for (const uint32_t word : words) {
    uint32_t index = first_free_;
    if (index == kEnd) {
      index = static_cast<uint32_t>(pool_.size());
      pool_.emplace_back();
    } else {
      first_free_ = pool_[index].next;
    }
    Chain& chain = FindOrAdd(word);
    pool_[index] = {slot, chain.first};
    chain = {index, chain.length + 1};
  }
  slot_end_ = std::max(slot_end_, slot + 1);
  ++document_count_;
}

void InvertedFile::Remove(uint32_t slot, const std::vector<uint32_t>& words) {
  for (const uint32_t word : words) {
    Chain* chain = Find(word);
    if (chain == nullptr) continue;
    uint32_t* link = &chain->first;
    while (*link != kEnd && pool_[*link].slot != slot) link = &pool_[*link].next;
    if (*link == kEnd) continue;
    const uint32_t index = *link;
    *link = pool_[index].next;
    pool_[index].next = first_free_;
    first_free_ = index;
    if (--chain->length == 0) Erase(word);
  }
  --document_count_;
}

std::vector<uint32_t> InvertedFile::Vote(const std::vector<uint32_t>& words,
                                         double max_frequency) const {
  std::vector<uint32_t> votes(slot_end_, 0);
  const size_t longest =
      std::max<size_t>(kAlwaysUsedPostings, static_cast<size_t>(max_frequency * document_count_));
  for (const uint32_t word : words) {
    const Chain* chain = Find(word);
    if (chain == nullptr || chain->length > longest) continue;
    // One more document than there is, so that a word of the only document still counts.
    const double idf = std::log((document_count_ + 1.0) / chain->length);
    const auto weight = static_cast<uint32_t>(std::lround(256.0 * idf));
    for (uint32_t i = chain->first; i != kEnd; i = pool_[i].next) {
      votes[pool_[i].slot] += weight;
    }
  }
  return votes;
}

}  // namespace portolan
