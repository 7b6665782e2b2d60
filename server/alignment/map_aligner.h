// Keeps the map model aligned: places new submaps, decides about closures, joins and parts
// components, adjusts windows at once and whole components in the background.
#ifndef PORTOLAN_SERVER_ALIGNMENT_MAP_ALIGNER_H_
#define PORTOLAN_SERVER_ALIGNMENT_MAP_ALIGNER_H_

#include <atomic>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "server/alignment/closure_judge.h"
#include "server/alignment/map_adjuster.h"
#include "server/alignment/map_model.h"
#include "server/alignment/map_relaxation.h"
#include "server/alignment/position_references.h"
#include "server/alignment/relation_graph.h"
#include "server/alignment/submap_relations.h"
#include "server/georeference/georeference_report.h"
#include "server/verification/closure.h"
#include "server/verification/pairwise_consistency.h"

namespace portolan {

struct MapAlignerOptions {
  MapModelOptions model;
  SubmapLinkOptions link;
  MapAdjusterOptions adjuster;
  MapRelaxationOptions relaxation;
  // How control points and fixes become terms, and the steps in which a component bends to them.
  PositionReferenceOptions positions;
  int bending_iterations = 10;
  RelationGraphOptions graph;
  PairwiseConsistencyOptions consistency;
  // For components whose waiting closures contradict the accepted ones.
  ClosureJudgeOptions judge;
  // Two components join by one closure with this many matches, or by two or more that agree.
  int min_matches_of_single_closure = 40;
  SubmapRelationsOptions relations;
  // An accepted closure is taken back if, after an adjustment of the whole component, less than
  // this share of its matches is seen consistently from both submaps.
  double min_surviving_matches = 0.3;
  // Submaps that a new one's local adjustment moves: so many predecessors, and its closures' ends.
  int window_predecessors = 2;
  int window_closures = 6;
  int local_iterations = 10;
  // Components up to this size are solved as a whole: the graph at every closure, the bundle
  // adjustment in the background. In larger ones the work at a submap is bounded: closures that
  // agree with the map are accepted as they are, others solve the region they affect, and the
  // background adjusts regions. In a map of more submaps, in whatever components, a new one stays
  // where its link and its closures place it until then. A background step on this many submaps
  // takes about a second (how long a new submap may wait).
  int full_component_submaps = 80;
  // Submaps that the background moves at once in a larger component.
  int region_submaps = 10;
  // A submap that neighbours moved is adjusted again so often between two relaxations. Regions
  // whose outliers depend on each other would otherwise take turns for ever.
  int max_region_visits = 3;
  // A large component is relaxed when its regions are adjusted, and before that whenever its
  // submaps or the closures have grown by this factor: regions about a loop that is not yet closed
  // take the closure's matches for outliers.
  double relaxing_growth = 1.25;
  // Components of no more submaps than this settle.
  int settled_component_submaps = 1200;
  // A closure that contradicts the map moves the submaps about its ends: so many at first, then
  // four times as many while the strain reaches the rim, up to the second number.
  int loop_region_submaps = 60;
  int max_loop_region_submaps = 2000;
  // Every new submap may cost as much as the solution of a region of so many; what it leaves is
  // saved for others, and for closures that the background judges. A closure for whose region the
  // savings do not suffice waits, in the end until the background has nothing else to do. In
  // submaps, not in seconds, so that runs can be repeated.
  int solving_credit_submaps = 250;
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
  void RestoreClosure(std::shared_ptr<const Closure> closure);
  void RestoreWaitingClosure(std::shared_ptr<const Closure> closure);

  // The component's world is the site frame about this origin.
  void RestoreGeoreference(ComponentId component, const SiteOrigin& origin);

  // Control points and origin, instead of those before. The background work that follows puts the
  // components that know enough positions into the site's frame and bends them.
  void SetSurvey(std::shared_ptr<const Survey> survey);

  // Links a refined submap to its predecessor, if that is there and sound, and places it.
  void AddSubmap(std::shared_ptr<const RefinedSubmap> refined);
  // Judges new closures (with those that wait): joins components, corrects drift, unites landmarks.
  void AddClosures(const std::vector<Closure>& closures);
  // Bundle adjustment of the submap and its neighbours, the rest held; in a large map, none.
  void AdjustAround(SubmapId id);

  bool HasBackgroundWork() const {
    return !stale_.empty() || !restless_.empty() || !strained_.empty() || !unjudged_.empty() ||
           relaxing_ != nullptr;
  }
  // Full adjustment of the component that waits longest, those with new closures first, or, in a
  // large component, of the region that does; then takes back closures that did not survive it.
  // Interrupted, it keeps what it gained.
  void AdjustStaleComponent(const std::atomic<bool>& interrupt);
  // Components that were adjusted since they settled; for times when nothing else is to do.
  bool HasUnsettled() const { return !unsettled_.empty(); }
  // So that the map no longer depends on the order and the moments in which it came about, but for
  // what was accepted: adjusts one component as SettleMap does (map_adjuster.h).
  void SettleComponent(const std::atomic<bool>& interrupt);

  const MapModel& model() const { return model_; }
  const ClosureList& closures() const { return relations_.closures(); }
  const ClosureList& waiting_closures() const { return pending_; }
  // Components with known positions or metric sensors, georeferenced or not; as of their last
  // adjustment.
  const std::map<ComponentId, std::shared_ptr<const GeoreferenceReport>>& georeferences() const {
    return georeferences_;
  }
  // Submaps whose pose, component or landmarks changed since the last call.
  std::set<SubmapId> TakeTouched();
  // Submaps that only moved since the last call, each nearly as a whole: their landmarks are made
  // of the same sights as before.
  std::set<SubmapId> TakeMoved();
  // Landmarks that changed since the last call, of submaps that otherwise did not; by the submap
  // that owns them (the oldest sight's).
  std::map<SubmapId, std::set<TrackId>> TakeTouchedLandmarks();
  // Of the right perturbation of world_from_submap, relative to the component's oldest submap: the
  // sum along the best chain of links and accepted closures.
  Matrix7d Covariance(SubmapId id) const { return relations_.Covariance(id); }

 private:
  std::optional<SubmapRelation> LinkOf(const RefinedSubmap& refined) const;
  std::optional<UncertainSimilarity> Relative(SubmapId a, SubmapId b) const {
    return relations_.Relative(model_, a, b);
  }
  bool IsLarge(ComponentId component) const {
    return model_.SizeOf(component) > static_cast<size_t>(options_.full_component_submaps);
  }
  // Joins and closes what the waiting closures allow (map_aligner_review.cc).
  void SettleWaiting();
  // Judges components anew in which closures wait that contradict the accepted ones; takes
  // accepted ones back if more speaks against them.
  void ReviewClosures();
  bool ReviewComponent(ComponentId component);
  // Once a submap: keyframes that disagree with all that they see, though the others do not, go
  // where the refined submap has them beside those. True if there are any.
  bool PutBackStrays(const std::vector<SubmapId>& ids);
  // Where matches contradict each other, those that come first unite landmarks: in an order that
  // does not depend on when their closures were accepted.
  void UniteAnew(ComponentId component, const std::vector<SubmapId>& ids);
  bool JoinComponents();
  void Join(const std::vector<Closure>& agreeing);
  // Of one component, or of all.
  bool CloseLoops(std::optional<ComponentId> only = std::nullopt);
  void Accept(std::shared_ptr<const Closure> closure);
  // New poses, parallel to ids, of a component whose graph was solved with one submap held, its
  // scale too, go back to the unit of the model. Metric or not: the graph measures no lengths, and
  // the unit that there was is the best that it knows.
  void KeepUnitOf(const std::vector<SubmapId>& ids, size_t held,
                  std::vector<Similarity3>* world_from_submap) const;
  void UniteMatches(const Closure& closure);
  void ErasePending(const std::function<bool(const Closure&)>& predicate);
  bool Survives(const Closure& closure) const;
  void DropFailedClosures(ComponentId component);
  // After an adjustment: what did not survive is taken back; what contradicted the map that wrong
  // closures had bent may agree with this one.
  void ReviseClosures(ComponentId component);
  void PartComponent(ComponentId component);
  // Moves the component's world to metres and a vertical axis, as its metric submaps have it,
  // unless it is in the site's frame.
  void MakeMetric(ComponentId component);
  void TouchComponent(ComponentId component);
  void Touch(const std::vector<SubmapId>& window);
  void MarkStale(SubmapId id, int urgency);

  // For known positions (map_aligner_georeference.cc).
  bool IsGeoreferenced(ComponentId component) const;
  // Puts the component into the site's frame if its positions determine that, and reports. False:
  // it is not there; otherwise `references` are all its positions.
  bool Georeference(ComponentId component, PositionReferences* references);
  // Relaxes the component if the positions ask for it. False: interrupted.
  bool BendToPositions(ComponentId component, const std::atomic<bool>& interrupt,
                       PositionReferences* references);
  void ChooseSite();
  void ReportProblem(ComponentId component, std::string problem);
  // What is left of the errors at known positions, of metric scales and of verticals.
  void ReportErrors(ComponentId component);
  void ReportPositions(ComponentId component, GeoreferenceReport* report) const;

  // Closures inside of large components (map_aligner_loops.cc).
  bool CloseLoopsLocally(std::vector<std::shared_ptr<const Closure>> candidates);
  // May not solve: only if it agrees with the map as it is.
  bool AcceptIfItAgrees(const std::shared_ptr<const Closure>& closure, bool may_solve);
  void EarnSolvingCredit();
  // Half of what can be saved up.
  bool HasMuchCredit() const;
  void JudgeUnjudged(const std::function<bool()>& may_go_on);
  // What waits in the component, for it has changed: accepts what agrees; of the others, those that
  // it contradicts less than before become unjudged.
  void JudgeAgain(ComponentId component);
  // Squared Mahalanobis distance of a closure from the map: by its own covariance, or with that of
  // the chain between its ends too; no value if that chain is too long.
  double Disagreement(const Closure& closure) const;
  std::optional<double> DisagreementAlongChain(const Closure& closure) const;
  bool SolveAround(const Closure& closure);
  enum class RegionOutcome { kSolved, kTooSmall, kContradicts };
  RegionOutcome SolveRegion(const Closure& closure, const std::vector<SubmapId>& region);

  // Regions of large components (map_aligner_regions.cc).
  void MoveRegion(const std::vector<SubmapId>& region,
                  const std::vector<Similarity3>& world_from_submap);
  // Submaps about the seeds, nearest first.
  std::vector<SubmapId> RegionAround(const std::vector<SubmapId>& seeds, size_t count) const;
  void AdjustRegion(const std::atomic<bool>& interrupt);
  // By the factor at which it is relaxed, in submaps or closures.
  bool HasGrown(ComponentId component) const;
  // Removes what regions leave: moves all submaps of the component, each as a whole. Interrupted,
  // it goes on with the next call, whatever was added meanwhile.
  void Relax(ComponentId component, const std::atomic<bool>& interrupt);
  void BeginRelaxation(ComponentId component);
  // Moves the submaps as the relaxation did, and those that came since with their neighbours.
  void TakeRelaxation();
  // The component moves to another world or comes apart.
  void CancelRelaxation(ComponentId component);
  void TakeBackFailed(const std::vector<SubmapId>& region);
  void SeparateMatches(const Closure& closure);
  void TouchLandmark(const LandmarkSight& sight);
  void TouchLandmarksOf(SubmapId id);

  MapAlignerOptions options_;
  MapModel model_;
  SubmapRelations relations_;
  std::shared_ptr<const Survey> survey_ = std::make_shared<const Survey>();
  std::optional<SiteOrigin> site_;
  bool has_fixes_ = false;  // some submap has
  std::map<ComponentId, std::shared_ptr<const GeoreferenceReport>> georeferences_;
  ClosureList pending_;
  // Waiting closures inside of large components that were judged, by their disagreement with the
  // map then, or wait for that, by infinity.
  std::map<const Closure*, double> seen_;
  std::deque<std::shared_ptr<const Closure>> unjudged_;
  int64_t solving_credit_ = 0;  // in submaps of regions; below zero: spent in advance
  // Waiting closures of two components, one of them large, when they were last judged.
  std::map<std::pair<ComponentId, ComponentId>, size_t> judged_group_sizes_;
  // Waiting closures inside of a component when it was last reviewed.
  std::map<ComponentId, size_t> reviewed_counts_;
  // Ends of closures that did not survive an adjustment once; another time they are forgotten.
  std::set<std::pair<SubmapId, SubmapId>> failed_once_;
  // Some of whose keyframes were put back.
  std::set<SubmapId> put_back_;
  std::map<SubmapKey, SubmapId> id_of_key_;
  // Urgency by component: 2 after a closure, 1 after a new submap.
  std::map<ComponentId, int> stale_;
  // Urgency by submap, in large components.
  std::map<SubmapId, int> restless_;
  // How often a submap was the centre of a region since the last relaxation.
  std::map<SubmapId, int> visits_;
  // Large components in which a region was adjusted since they were relaxed.
  std::set<ComponentId> strained_;
  struct Relaxed {
    size_t submaps = 0;
    size_t closures = 0;  // of the map
    double cost = 0;
  };
  // As they were when last relaxed.
  std::map<ComponentId, Relaxed> relaxed_;
  // The one that was interrupted; null if none was.
  struct Relaxing {
    ComponentId component;
    size_t closures = 0;                     // of the map, when it began
    std::map<SubmapId, Similarity3> before;  // world_from_submap
    std::unique_ptr<MapRelaxation> relaxation;
  };
  std::unique_ptr<Relaxing> relaxing_;
  // Adjusted or, if large, relaxed since they settled.
  std::set<ComponentId> unsettled_;
  // Size of a large component when its scale and vertical were last checked.
  std::map<ComponentId, size_t> metric_checked_size_;
  std::set<SubmapId> touched_;
  std::set<SubmapId> moved_;
  std::map<SubmapId, std::set<TrackId>> touched_landmarks_;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_ALIGNMENT_MAP_ALIGNER_H_
