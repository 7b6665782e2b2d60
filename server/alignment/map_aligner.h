// Keeps the map model aligned: places new submaps, decides about closures, joins and parts
// components, adjusts windows at once and whole components in the background.
#ifndef PORTOLAN_SERVER_ALIGNMENT_MAP_ALIGNER_H_
#define PORTOLAN_SERVER_ALIGNMENT_MAP_ALIGNER_H_

#include <atomic>
#include <map>
#include <memory>
#include <set>
#include <vector>

#include "server/alignment/map_adjuster.h"
#include "server/alignment/map_model.h"
#include "server/alignment/relation_graph.h"
#include "server/verification/closure.h"
#include "server/verification/pairwise_consistency.h"

namespace portolan {

struct MapAlignerOptions {
  MapModelOptions model;
  SubmapLinkOptions link;
  MapAdjusterOptions adjuster;
  RelationGraphOptions graph;
  PairwiseConsistencyOptions consistency;
  // Two components join by one closure with this many matches, or by two or more that agree.
  int min_matches_of_single_closure = 40;
  // Standard deviations that closures are not believed beyond: their landmarks share errors.
  double closure_translation_floor_of_depth = 0.01;
  double closure_rotation_floor_rad = 0.01;
  double closure_log_scale_floor = 0.02;
  // An accepted closure is taken back if, after an adjustment of the whole component, less than
  // this share of its matches is seen consistently from both submaps.
  double min_surviving_matches = 0.3;
  // Submaps that a new one's local adjustment moves: so many predecessors, and its closures' ends.
  int window_predecessors = 2;
  int window_closures = 6;
  int local_iterations = 10;
  // Closures that were not accepted are kept for this many later ones to agree with.
  int max_pending = 1000;

  Status Validate() const;
};

// Thread-compatible.
class MapAligner {
 public:
  // The options are valid.
  explicit MapAligner(const MapAlignerOptions& options);

  // Continue a stored map, before anything is added: its submaps by ascending id, its landmarks,
  // its accepted closures.
  void RestoreSubmap(const PlacedSubmap& placed);
  void RestoreLandmark(const ModelLandmark& known) { model_.RestoreLandmark(known); }
  void RestoreClosure(const Closure& closure);
  void RestoreWaitingClosure(const Closure& closure);

  // Links a refined submap to its predecessor, if that is there and sound, and places it.
  void AddSubmap(std::shared_ptr<const RefinedSubmap> refined);
  // Judges new closures (with those that wait): joins components, corrects drift, unites landmarks.
  void AddClosures(const std::vector<Closure>& closures);
  // Bundle adjustment of the submap and its neighbours, the rest held.
  void AdjustAround(SubmapId id);

  bool HasBackgroundWork() const { return !stale_.empty(); }
  // Full adjustment of the component that waits longest, those with new closures first; then
  // takes back closures that did not survive it. Interrupted, it keeps what it gained.
  void AdjustStaleComponent(const std::atomic<bool>& interrupt);

  const MapModel& model() const { return model_; }
  const std::vector<Closure>& closures() const { return accepted_; }
  const std::vector<Closure>& waiting_closures() const { return pending_; }
  const MapAdjustment& last_adjustment() const { return last_adjustment_; }
  // Submaps whose pose, component or landmarks changed since the last call.
  std::set<SubmapId> TakeTouched();
  // Of the right perturbation of world_from_submap, relative to the component's oldest submap: the
  // sum along the best chain of links and accepted closures.
  Matrix7d Covariance(SubmapId id) const;

 private:
  struct Neighbour {
    SubmapId submap;
    Similarity3 from_neighbour;  // this submap's frame from the neighbour's
    Matrix7d covariance;         // of its right perturbation
  };

  std::optional<SubmapRelation> LinkOf(const RefinedSubmap& refined) const;
  std::vector<Neighbour> NeighboursOf(SubmapId id) const;
  std::optional<UncertainSimilarity> Relative(SubmapId a, SubmapId b) const;
  Matrix7d FlooredCovariance(const Closure& closure) const;
  bool JoinComponents();
  void Join(const std::vector<Closure>& agreeing);
  bool CloseLoops();
  void Accept(const Closure& closure);
  void UniteMatches(const Closure& closure);
  bool Survives(const Closure& closure) const;
  void DropFailedClosures(ComponentId component);
  void PartComponent(ComponentId component);
  // Moves the component's world to metres and a vertical axis, as its metric submaps have it.
  void MakeMetric(ComponentId component);
  void TouchComponent(ComponentId component);
  void Touch(const std::vector<SubmapId>& window);
  void MarkStale(ComponentId component, int urgency);

  MapAlignerOptions options_;
  MapModel model_;
  std::vector<Closure> accepted_;
  std::vector<Closure> pending_;
  // Ends of accepted closures by submap, as indices into accepted_.
  std::map<SubmapId, std::vector<size_t>> closures_of_;
  std::map<SubmapKey, SubmapId> id_of_key_;
  // Urgency by component: 2 after a closure, 1 after a new submap.
  std::map<ComponentId, int> stale_;
  std::set<SubmapId> touched_;
  MapAdjustment last_adjustment_;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_ALIGNMENT_MAP_ALIGNER_H_
