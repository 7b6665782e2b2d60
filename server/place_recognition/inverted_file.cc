#include "server/place_recognition/inverted_file.h"

#include <algorithm>
#include <cmath>

namespace portolan {
namespace {

// Words with no more documents than this are used however small the map is.
constexpr size_t kAlwaysUsedPostings = 30;

}  // namespace

void InvertedFile::Add(uint32_t slot, const std::vector<uint32_t>& words) {
  for (const uint32_t word : words) postings_[word].push_back(slot);
  slot_end_ = std::max(slot_end_, slot + 1);
  ++document_count_;
}

void InvertedFile::Remove(uint32_t slot, const std::vector<uint32_t>& words) {
  for (const uint32_t word : words) {
    const auto it = postings_.find(word);
    if (it == postings_.end()) continue;
    std::vector<uint32_t>& slots = it->second;
    slots.erase(std::remove(slots.begin(), slots.end(), slot), slots.end());
    if (slots.empty()) postings_.erase(it);
  }
  --document_count_;
}

std::vector<uint32_t> InvertedFile::Vote(const std::vector<uint32_t>& words,
                                         double max_frequency) const {
  std::vector<uint32_t> votes(slot_end_, 0);
  const size_t longest =
      std::max<size_t>(kAlwaysUsedPostings, static_cast<size_t>(max_frequency * document_count_));
  for (const uint32_t word : words) {
    const auto it = postings_.find(word);
    if (it == postings_.end() || it->second.size() > longest) continue;
    // One more document than there is, so that a word of the only document still counts.
    const double idf = std::log((document_count_ + 1.0) / static_cast<double>(it->second.size()));
    const auto weight = static_cast<uint32_t>(std::lround(256.0 * idf));
    for (const uint32_t slot : it->second) votes[slot] += weight;
  }
  return votes;
}

}  // namespace portolan
