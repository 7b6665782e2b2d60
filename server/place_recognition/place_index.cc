#include "server/place_recognition/place_index.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <optional>
#include <utility>

#include "absl/container/flat_hash_map.h"
#include "absl/strings/str_cat.h"
#include "common/features/descriptor_table.h"
#include "server/place_recognition/inverted_file.h"
#include "server/place_recognition/locality_words.h"

namespace portolan {
namespace {

// Features of one track form a group, every other feature is a group of its own: a point counts
// once, however often it was described.
struct Groups {
  std::vector<uint32_t> of_feature;  // 0..count-1
  uint32_t count = 0;
};

// The described features of a submap, thinned, and their groups.
struct Place {
  DescriptorTable descriptors;
  Groups groups;
};

Status CheckRange(const char* name, double value, double low, double high) {
  if (value >= low && value <= high) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat("place index: ", name, " = ", value, " is not in [", low, ", ", high, "]"));
}

std::vector<const Feature*> ThinnedFeatures(const Submap& submap, size_t max_features) {
  std::vector<const Feature*> features;
  size_t all = 0;
  for (const Keyframe& keyframe : submap.keyframes) all += keyframe.features.size();
  features.reserve(all);
  for (const Keyframe& keyframe : submap.keyframes) {
    for (const Feature& feature : keyframe.features) features.push_back(&feature);
  }
  const size_t count = std::min(features.size(), max_features);
  for (size_t i = 0; i < count; ++i) features[i] = features[i * features.size() / count];
  features.resize(count);
  return features;
}

DescriptorTable DescriptorsOf(const std::vector<const Feature*>& features) {
  DescriptorTable descriptors;
  descriptors.Reserve(features.size());
  for (const Feature* feature : features) descriptors.Append(feature->descriptor);
  return descriptors;
}

Groups GroupsOf(const std::vector<const Feature*>& features) {
  Groups groups;
  groups.of_feature.reserve(features.size());
  absl::flat_hash_map<TrackId, uint32_t> group_of_track;
  for (const Feature* feature : features) {
    uint32_t group = groups.count;
    if (feature->track) group = group_of_track.try_emplace(*feature->track, group).first->second;
    groups.count += group == groups.count;
    groups.of_feature.push_back(group);
  }
  return groups;
}

std::vector<uint32_t> WordsOf(const std::vector<const Feature*>& features,
                              const LocalityWords& locality_words) {
  std::vector<uint32_t> words;
  for (const Feature* feature : features) locality_words.AppendWords(feature->descriptor, &words);
  std::sort(words.begin(), words.end());
  words.erase(std::unique(words.begin(), words.end()), words.end());
  return words;
}

// The nearest descriptor of one place to one feature of the query.
struct Support {
  double weight = 0;
  uint32_t group = 0;  // of the place
};

// Similarity of a query to each of a few places. A feature's support for a place falls off with
// the distance of its nearest neighbour there, relative to its mean support for all the places: a
// feature that looks like something everywhere says nothing. Of the features of one group, and of
// the supporters of one group of the place, the best counts.
class SimilarityScorer {
 public:
  SimilarityScorer(const PlaceIndexOptions& options, const Place& query)
      : options_(options), query_(query) {
    for (size_t d = 0; d < weight_at_.size(); ++d) {
      weight_at_[d] = std::exp(-static_cast<double>(d) / options.falloff_bits);
    }
    const size_t size = query.descriptors.size();
    const size_t count = std::min<size_t>(size, options.max_compared_features);
    for (size_t i = 0; i < count; ++i) used_.push_back(i * size / count);
  }

  void Add(const DescriptorTable& descriptors, const Groups& groups) {
    std::vector<Support>& support = supports_.emplace_back();
    for (const size_t q : used_) {
      const auto [distance, index] = descriptors.Nearest(query_.descriptors[q]);
      support.push_back(distance > 256 ? Support{}
                                       : Support{weight_at_[distance], groups.of_feature[index]});
    }
    group_counts_.push_back(groups.count);
  }

  // In the order of Add.
  std::vector<double> Scores() {
    Normalise();
    std::vector<double> scores;
    for (size_t p = 0; p < supports_.size(); ++p) {
      scores.push_back(SumOfBest(supports_[p], group_counts_[p]));
    }
    return scores;
  }

 private:
  void Normalise() {
    const double noise = std::exp(-options_.noise_bits / options_.falloff_bits);
    for (size_t i = 0; i < used_.size(); ++i) {
      double mean = 0;
      for (const auto& support : supports_) mean += support[i].weight / supports_.size();
      for (auto& support : supports_) support[i].weight /= mean + noise;
    }
  }

  double SumOfBest(const std::vector<Support>& support, uint32_t place_group_count) const {
    std::vector<Support> of_query(query_.groups.count);
    for (size_t i = 0; i < used_.size(); ++i) {
      Support& best = of_query[query_.groups.of_feature[used_[i]]];
      if (support[i].weight > best.weight) best = support[i];
    }
    std::vector<double> of_place(place_group_count, 0.0);
    for (const Support& best : of_query) {
      if (best.weight > 0) of_place[best.group] = std::max(of_place[best.group], best.weight);
    }
    return std::accumulate(of_place.begin(), of_place.end(), 0.0);
  }

  const PlaceIndexOptions& options_;
  const Place& query_;
  std::array<double, 257> weight_at_;
  std::vector<size_t> used_;  // indices of the query's features
  // By place; parallel to used_.
  std::vector<std::vector<Support>> supports_;
  std::vector<uint32_t> group_counts_;
};

bool IsBetter(const PlaceCandidate& a, const PlaceCandidate& b) {
  return a.score != b.score ? a.score > b.score : a.submap < b.submap;
}

void KeepBest(size_t count, std::vector<PlaceCandidate>* candidates) {
  count = std::min(count, candidates->size());
  std::partial_sort(candidates->begin(), candidates->begin() + count, candidates->end(), IsBetter);
  candidates->resize(count);
}

}  // namespace

Status PlaceIndexOptions::Validate() const {
  PORTOLAN_RETURN_IF_ERROR(CheckRange("tables", tables, 1, 32));
  PORTOLAN_RETURN_IF_ERROR(CheckRange("bits_per_word", bits_per_word, 8, 24));
  PORTOLAN_RETURN_IF_ERROR(CheckRange("max_features", max_features, 1, 100000));
  PORTOLAN_RETURN_IF_ERROR(CheckRange("max_word_frequency", max_word_frequency, 0, 1));
  PORTOLAN_RETURN_IF_ERROR(CheckRange("shortlist", shortlist, 1, 1000000));
  PORTOLAN_RETURN_IF_ERROR(CheckRange("max_compared_features", max_compared_features, 1, 100000));
  PORTOLAN_RETURN_IF_ERROR(CheckRange("falloff_bits", falloff_bits, 1, 256));
  return CheckRange("noise_bits", noise_bits, 0, 256);
}

class PlaceIndex::Impl {
 public:
  explicit Impl(const PlaceIndexOptions& options)
      : options_(options),
        locality_words_(options.tables, options.bits_per_word),
        inverted_file_(locality_words_.word_count()) {}

  void Add(SubmapId id, std::shared_ptr<const Submap> submap) {
    Remove(id);
    const std::vector<const Feature*> features = FeaturesOf(*submap);
    const uint32_t slot = TakeSlot();
    inverted_file_.Add(slot, WordsOf(features, locality_words_));
    slots_[slot] = Entry{id, std::move(submap), GroupsOf(features)};
    slot_of_.emplace(id, slot);
  }

  void Remove(SubmapId id) {
    const auto it = slot_of_.find(id);
    if (it == slot_of_.end()) return;
    const uint32_t slot = it->second;
    inverted_file_.Remove(slot, WordsOf(FeaturesOf(*slots_[slot]->submap), locality_words_));
    slots_[slot].reset();
    free_slots_.push_back(slot);
    slot_of_.erase(it);
  }

  std::vector<PlaceCandidate> Query(const Submap& submap, int max_candidates,
                                    const std::function<bool(SubmapId)>& admissible) const {
    if (max_candidates <= 0) return {};
    const std::vector<const Feature*> features = FeaturesOf(submap);
    std::vector<PlaceCandidate> candidates = Shortlist(features, max_candidates, admissible);
    const Place query = {DescriptorsOf(features), GroupsOf(features)};
    SimilarityScorer scorer(options_, query);
    for (const PlaceCandidate& candidate : candidates) {
      const Entry& entry = *slots_[slot_of_.at(candidate.submap)];
      scorer.Add(DescriptorsOf(FeaturesOf(*entry.submap)), entry.groups);
    }
    const std::vector<double> scores = scorer.Scores();
    for (size_t i = 0; i < candidates.size(); ++i) candidates[i].score = scores[i];
    std::erase_if(candidates, [](const PlaceCandidate& c) { return c.score <= 0; });
    KeepBest(max_candidates, &candidates);
    return candidates;
  }

  int submap_count() const { return static_cast<int>(slot_of_.size()); }

 private:
  struct Entry {
    SubmapId id;
    // Its descriptors are laid out for the comparison when they are compared: copies of all of them
    // would take a third of the index.
    std::shared_ptr<const Submap> submap;
    Groups groups;
  };

  std::vector<const Feature*> FeaturesOf(const Submap& submap) const {
    return ThinnedFeatures(submap, options_.max_features);
  }

  uint32_t TakeSlot() {
    if (free_slots_.empty()) {
      slots_.emplace_back();
      return static_cast<uint32_t>(slots_.size() - 1);
    }
    const uint32_t slot = free_slots_.back();
    free_slots_.pop_back();
    return slot;
  }

  // The admissible submaps with most votes; all of them if they are few.
  std::vector<PlaceCandidate> Shortlist(const std::vector<const Feature*>& query,
                                        int max_candidates,
                                        const std::function<bool(SubmapId)>& admissible) const {
    const size_t count = std::max(options_.shortlist, max_candidates);
    const bool vote = slot_of_.size() > count;
    std::vector<uint32_t> votes(slots_.size(), 0);
    if (vote) {
      votes = inverted_file_.Vote(WordsOf(query, locality_words_), options_.max_word_frequency);
    }
    std::vector<PlaceCandidate> candidates;
    for (size_t slot = 0; slot < slots_.size(); ++slot) {
      if (!slots_[slot] || (vote && votes[slot] == 0)) continue;
      const SubmapId id = slots_[slot]->id;
      if (!admissible || admissible(id)) candidates.push_back({id, double(votes[slot])});
    }
    KeepBest(count, &candidates);
    return candidates;
  }

  const PlaceIndexOptions options_;
  const LocalityWords locality_words_;
  InvertedFile inverted_file_;
  std::vector<std::optional<Entry>> slots_;
  std::vector<uint32_t> free_slots_;
  absl::flat_hash_map<SubmapId, uint32_t> slot_of_;
};

PlaceIndex::PlaceIndex(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
PlaceIndex::~PlaceIndex() = default;

StatusOr<std::unique_ptr<PlaceIndex>> PlaceIndex::Create(const PlaceIndexOptions& options) {
  PORTOLAN_RETURN_IF_ERROR(options.Validate());
  return std::unique_ptr<PlaceIndex>(new PlaceIndex(std::make_unique<Impl>(options)));
}

void PlaceIndex::Add(SubmapId id, std::shared_ptr<const Submap> submap) {
  impl_->Add(id, std::move(submap));
}

void PlaceIndex::Remove(SubmapId id) { impl_->Remove(id); }

std::vector<PlaceCandidate> PlaceIndex::Query(
    const Submap& submap, int max_candidates,
    const std::function<bool(SubmapId)>& admissible) const {
  return impl_->Query(submap, max_candidates, admissible);
}

int PlaceIndex::submap_count() const { return impl_->submap_count(); }

}  // namespace portolan
