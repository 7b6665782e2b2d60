// Place recognition: which submaps, of any agent and any earlier session, show the same place.
#ifndef PORTOLAN_SERVER_PLACE_RECOGNITION_PLACE_INDEX_H_
#define PORTOLAN_SERVER_PLACE_RECOGNITION_PLACE_INDEX_H_

#include <functional>
#include <memory>
#include <vector>

#include "common/base/status.h"
#include "common/base/strong_id.h"
#include "common/submap/submap.h"

namespace portolan {

struct PlaceIndexOptions {
  // Words: `tables` times `bits_per_word` bits drawn from the 256 (see locality_words.h). More
  // tables find more, longer words cost less; the figures are in README.md.
  int tables = 8;
  int bits_per_word = 20;
  // Described features kept of a submap; more are thinned evenly. Bounds memory (8 bytes a
  // word, a word a table) and time.
  int max_features = 1200;
  // Words that more than this share of the submaps hold (and more than 30) say little and cost
  // most of the time; they are skipped.
  double max_word_frequency = 0.02;
  // Submaps with most votes, compared exactly afterwards. A map of no more submaps than this is
  // searched exhaustively.
  int shortlist = 40;
  // Features of the query used in the exact comparison; more are thinned evenly.
  int max_compared_features = 400;
  // A nearest neighbour at d bits weighs exp(-d / falloff_bits) ...
  double falloff_bits = 9.0;
  // ... relative to the mean weight over the shortlist plus the weight at this distance, at which
  // a neighbour says nothing.
  double noise_bits = 50.0;

  Status Validate() const;
};

struct PlaceCandidate {
  SubmapId submap;
  // Higher is better; comparable within one query only.
  double score = 0;
};

// Purpose: an incremental index of the submaps' binary descriptors; Add what was committed, Query
// before or after.
// Deterministic: the answer depends on the set of submaps in the index only, not on the order in
// which they came.
// Thread rule: thread-compatible (Query is const and may run in several threads while nobody adds
// or removes).
class PlaceIndex {
 public:
  // InvalidArgument if the options are.
  static StatusOr<std::unique_ptr<PlaceIndex>> Create(const PlaceIndexOptions& options);
  ~PlaceIndex();
  PlaceIndex(const PlaceIndex&) = delete;
  PlaceIndex& operator=(const PlaceIndex&) = delete;

  // Indexes the features of the described keyframes; a submap without features is legal and never
  // found. Adding an id again replaces what it had. Keeps the submap, whose descriptors it reads.
  void Add(SubmapId id, std::shared_ptr<const Submap> submap);
  // Forgets a submap; no effect if it is not there.
  void Remove(SubmapId id);

  // The best submaps by descending score (ties by ascending id), at most max_candidates, among
  // those for which admissible(id) holds (an empty function admits all; use it to leave out the
  // submap itself, its neighbours and quarantined ones).
  std::vector<PlaceCandidate> Query(const Submap& submap, int max_candidates,
                                    const std::function<bool(SubmapId)>& admissible) const;

  int submap_count() const;

 private:
  class Impl;
  explicit PlaceIndex(std::unique_ptr<Impl> impl);

  std::unique_ptr<Impl> impl_;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_PLACE_RECOGNITION_PLACE_INDEX_H_
