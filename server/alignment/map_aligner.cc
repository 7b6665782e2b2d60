#include "server/alignment/map_aligner.h"

#include <algorithm>
#include <span>
#include <utility>

#include "common/linear_algebra/dense.h"
#include "server/alignment/unit_keeping.h"

namespace portolan {
Status MapAlignerOptions::Validate() const {
  PORTOLAN_RETURN_IF_ERROR(model.Validate());
  PORTOLAN_RETURN_IF_ERROR(link.Validate());
  PORTOLAN_RETURN_IF_ERROR(adjuster.Validate());
  PORTOLAN_RETURN_IF_ERROR(relaxation.Validate());
  PORTOLAN_RETURN_IF_ERROR(positions.Validate());
  PORTOLAN_RETURN_IF_ERROR(graph.Validate());
  PORTOLAN_RETURN_IF_ERROR(consistency.Validate());
  PORTOLAN_RETURN_IF_ERROR(judge.Validate());
  PORTOLAN_RETURN_IF_ERROR(relations.Validate());
  if (full_component_submaps < 1 || region_submaps < 1 || loop_region_submaps < 2 ||
      max_loop_region_submaps < loop_region_submaps || solving_credit_submaps < 1 ||
      max_region_visits < 1 || !(relaxing_growth > 1) || bending_iterations < 1) {
    return absl::InvalidArgumentError("map aligner: sizes must be positive");
  }
  if (min_matches_of_single_closure < 1 ||
      !(min_surviving_matches >= 0 && min_surviving_matches <= 1) || window_predecessors < 0 ||
      window_closures < 0 || local_iterations < 1 || max_pending < 0) {
    return absl::InvalidArgumentError("map aligner: limits out of range");
  }
  return absl::OkStatus();
}

MapAligner::MapAligner(const MapAlignerOptions& options)
    : options_(options), model_(options.model), relations_(options.relations) {}

void MapAligner::RestoreSubmap(const PlacedSubmap& placed) {
  const SubmapId id = placed.refined->id;
  model_.Restore(placed, LinkOf(*placed.refined));
  id_of_key_[placed.refined->raw->key] = id;
  has_fixes_ = has_fixes_ || !placed.refined->raw->gnss.empty();
  relations_.AddSubmap(model_, id);
  if (!model_.submap(id).quarantined()) MarkStale(id, 1);
}

void MapAligner::RestoreClosure(std::shared_ptr<const Closure> closure) {
  if (model_.Contains(closure->a) && model_.Contains(closure->b)) Accept(std::move(closure));
}

std::optional<SubmapRelation> MapAligner::LinkOf(const RefinedSubmap& refined) const {
  if (refined.raw->link != LinkType::kConnected || !refined.quarantine_reason.empty()) {
    return std::nullopt;
  }
  SubmapKey key = refined.raw->key;
  if (key.sequence_number == 0) return std::nullopt;
  --key.sequence_number;
  const auto it = id_of_key_.find(key);
  if (it == id_of_key_.end()) return std::nullopt;
  const ModelSubmap& predecessor = model_.submap(it->second);
  if (predecessor.quarantined() || predecessor.successor) return std::nullopt;
  return LinkToPredecessor(options_.link, *predecessor.refined, refined);
}

void MapAligner::RestoreWaitingClosure(std::shared_ptr<const Closure> closure) {
  if (model_.Contains(closure->a) && model_.Contains(closure->b)) {
    pending_.push_back(std::move(closure));
  }
}

void MapAligner::AddSubmap(std::shared_ptr<const RefinedSubmap> refined) {
  const SubmapId id = refined->id;
  id_of_key_[refined->raw->key] = id;
  has_fixes_ = has_fixes_ || !refined->raw->gnss.empty();
  const std::optional<SubmapRelation> link = LinkOf(*refined);
  model_.Add(std::move(refined), link);
  relations_.AddSubmap(model_, id);
  if (IsLarge(model_.submap(id).component)) {
    touched_.insert(id);
    TouchLandmarksOf(id);
  } else {
    Touch({id});
  }
  if (!model_.submap(id).quarantined()) MarkStale(id, 1);
}

void MapAligner::AddClosures(const std::vector<Closure>& closures) {
  EarnSolvingCredit();
  // The background's work, but it has no time if so much is unspent.
  JudgeUnjudged([this] { return HasMuchCredit(); });
  if (closures.empty()) return;
  for (const Closure& closure : closures) {
    if (model_.Contains(closure.a) && model_.Contains(closure.b)) pending_.push_back(closure);
  }
  SettleWaiting();
  ReviewClosures();
  if (pending_.size() > static_cast<size_t>(options_.max_pending)) {
    size_t surplus = pending_.size() - options_.max_pending;
    ErasePending([&](const Closure&) { return surplus > 0 && surplus-- > 0; });
  }
}

bool MapAligner::JoinComponents() {
  std::map<std::pair<ComponentId, ComponentId>, std::vector<Closure>> groups;
  for (const Closure& closure : pending_) {
    const ComponentId a = model_.submap(closure.a).component;
    const ComponentId b = model_.submap(closure.b).component;
    if (a != b) groups[std::minmax(a, b)].push_back(closure);
  }
  const auto relative = [this](SubmapId a, SubmapId b) { return Relative(a, b); };
  // The pair with the most agreeing closures joins first; the others may then be loops.
  std::vector<Closure> strongest;
  for (const auto& [components, closures] : groups) {
    // With a large component a group is judged again only when it has grown.
    if (IsLarge(components.first) || IsLarge(components.second)) {
      size_t& judged = judged_group_sizes_[components];
      if (judged == closures.size()) continue;
      judged = closures.size();
    }
    std::vector<Closure> agreeing;
    for (const size_t i : LargestConsistentSet(closures, relative, options_.consistency)) {
      agreeing.push_back(closures[i]);
    }
    const bool single = agreeing.size() == 1 && static_cast<int>(agreeing[0].matches.size()) >=
                                                    options_.min_matches_of_single_closure;
    if (agreeing.size() < 2 && !single) continue;
    if (agreeing.size() > strongest.size()) strongest = std::move(agreeing);
  }
  if (strongest.empty()) return false;
  Join(strongest);
  return true;
}

// Moves the younger component by the closure with the most matches.
void MapAligner::Join(const std::vector<Closure>& agreeing) {
  const Closure best = *std::max_element(
      agreeing.begin(), agreeing.end(),
      [](const Closure& a, const Closure& b) { return a.matches.size() < b.matches.size(); });
  const ModelSubmap& a = model_.submap(best.a);
  const ModelSubmap& b = model_.submap(best.b);
  const Similarity3 a_world_from_b_world =
      a.world_from_submap * best.a_from_b * b.world_from_submap.Inverse();
  const ComponentId in_a = a.component;
  const ComponentId in_b = b.component;
  stale_.erase(std::max(in_a, in_b));
  georeferences_.erase(std::max(in_a, in_b));
  CancelRelaxation(std::max(in_a, in_b));
  const std::vector<SubmapId> moved = model_.SubmapsOf(std::max(in_a, in_b));
  if (in_a < in_b) {
    model_.MoveComponent(in_b, in_a, a_world_from_b_world);
  } else {
    model_.MoveComponent(in_a, in_b, a_world_from_b_world.Inverse());
  }
  ErasePending([&](const Closure& closure) { return closure.a == best.a && closure.b == best.b; });
  Accept(std::make_shared<const Closure>(best));
  judged_group_sizes_.clear();
  relations_.Rechain(model_, moved);
  if (IsLarge(std::min(in_a, in_b))) {
    moved_.insert(moved.begin(), moved.end());
  } else {
    TouchComponent(std::min(in_a, in_b));
  }
}

// Solves the graph of each component that has waiting closures; those that fit are accepted. Links
// and accepted closures enter as the map has them now, so that what the adjustments gained stays.
bool MapAligner::CloseLoops(std::optional<ComponentId> only) {
  std::map<ComponentId, std::vector<size_t>> loops;
  std::vector<std::shared_ptr<const Closure>> in_large;
  for (size_t i = 0; i < pending_.size(); ++i) {
    const ComponentId component = model_.submap(pending_[i].a).component;
    if (component != model_.submap(pending_[i].b).component) continue;
    if (only && component != *only) continue;
    if (IsLarge(component)) {
      in_large.push_back(pending_.shared(i));
    } else {
      loops[component].push_back(i);
    }
  }
  if (loops.empty()) return CloseLoopsLocally(in_large);
  std::set<const Closure*> closed;
  for (const auto& [component, candidates] : loops) {
    const std::vector<SubmapId> ids = model_.SubmapsOf(component);
    std::map<SubmapId, int> nodes;
    RelationGraph graph;
    for (const SubmapId id : ids) {
      nodes[id] = static_cast<int>(nodes.size());
      graph.world_from_node.push_back(model_.submap(id).world_from_submap);
      graph.fixed.push_back(graph.fixed.empty());
    }
    const auto add = [&](SubmapId a, SubmapId b, const Matrix7d& information) {
      const Similarity3 a_from_b =
          model_.submap(a).world_from_submap.Inverse() * model_.submap(b).world_from_submap;
      graph.relations.push_back({nodes.at(a), nodes.at(b), a_from_b, information, false});
    };
    for (const SubmapId id : ids) {
      if (const auto& link = model_.submap(id).link) add(link->a, id, link->information);
    }
    for (const Closure& closure : closures()) {
      if (nodes.contains(closure.a)) {
        add(closure.a, closure.b,
            InverseOfPositiveDefinite(relations_.FlooredCovariance(model_, closure)));
      }
    }
    const size_t first = graph.relations.size();
    for (const size_t i : candidates) {
      const Closure& closure = pending_[i];
      graph.relations.push_back(
          {nodes.at(closure.a), nodes.at(closure.b), closure.a_from_b,
           InverseOfPositiveDefinite(relations_.FlooredCovariance(model_, closure)), true});
    }
    const std::vector<double> weights = SolveRelationGraph(options_.graph, &graph);
    const size_t before = closed.size();
    for (size_t i = 0; i < candidates.size(); ++i) {
      if (weights[first + i] > 0.5) closed.insert(&pending_[candidates[i]]);
    }
    if (closed.size() == before) continue;
    KeepUnitOf(ids, 0, &graph.world_from_node);
    for (size_t i = 0; i < ids.size(); ++i) model_.MoveSubmap(ids[i], graph.world_from_node[i]);
    TouchComponent(component);
  }
  ClosureList now = pending_;
  now.EraseIf([&](const Closure& closure) { return !closed.contains(&closure); });
  ErasePending([&](const Closure& closure) { return closed.contains(&closure); });
  for (size_t i = 0; i < now.size(); ++i) Accept(now.shared(i));
  return CloseLoopsLocally(in_large) || !now.empty();
}

void MapAligner::KeepUnitOf(const std::vector<SubmapId>& ids, size_t held,
                            std::vector<Similarity3>* world_from_submap) const {
  std::vector<std::pair<Eigen::Vector3d, Eigen::Vector3d>> moved;
  for (size_t i = 0; i < ids.size(); ++i) {
    moved.emplace_back(model_.submap(ids[i]).world_from_submap.translation,
                       (*world_from_submap)[i].translation);
  }
  const Similarity3 change = KeepUnit(moved[held].first, moved);
  for (Similarity3& pose : *world_from_submap) pose = change * pose;
}

void MapAligner::Accept(std::shared_ptr<const Closure> closure) {
  relations_.AddClosure(model_, closure);
  UniteMatches(*closure);
  MarkStale(closure->a, 2);
  MarkStale(closure->b, 2);
}

void MapAligner::ErasePending(const std::function<bool(const Closure&)>& predicate) {
  pending_.EraseIf([&](const Closure& closure) {
    const bool erased = predicate(closure);
    if (erased) seen_.erase(&closure);
    return erased;
  });
}

void MapAligner::UniteMatches(const Closure& closure) {
  for (const LandmarkMatch& match : closure.matches) {
    TouchLandmark({closure.a, match.in_a});
    TouchLandmark({closure.b, match.in_b});
    model_.UniteLandmarks({closure.a, match.in_a}, {closure.b, match.in_b});
  }
}

void MapAligner::AdjustAround(SubmapId id) {
  if (model_.submap(id).quarantined()) return;
  // Adjusted alone to the landmarks that are there, whose errors would then be its own, a submap
  // bends several times as much as its link is uncertain, and closures no longer fit the map.
  if (model_.submaps().size() > static_cast<size_t>(options_.full_component_submaps)) return;
  MakeMetric(model_.submap(id).component);
  std::set<SubmapId> window = {id};
  SubmapId predecessor = id;
  for (int i = 0; i < options_.window_predecessors && model_.submap(predecessor).link; ++i) {
    predecessor = model_.submap(predecessor).link->a;
    window.insert(predecessor);
  }
  std::vector<size_t> order = relations_.ClosuresOf(id);
  std::stable_sort(order.begin(), order.end(), [this](size_t a, size_t b) {
    return closures()[a].matches.size() > closures()[b].matches.size();
  });
  if (order.size() > static_cast<size_t>(options_.window_closures)) {
    order.resize(options_.window_closures);
  }
  for (const size_t i : order) window.insert({closures()[i].a, closures()[i].b});
  MapAdjusterOptions local = options_.adjuster;
  local.bundle.max_iterations = options_.local_iterations;
  const std::vector<SubmapId> ids(window.begin(), window.end());
  AdjustMap(local, ids, 1, nullptr, &model_);
  Touch(ids);
}

void MapAligner::AdjustStaleComponent(const std::atomic<bool>& interrupt) {
  if (stale_.empty()) {
    AdjustRegion(interrupt);
    return;
  }
  const auto most =
      std::max_element(stale_.begin(), stale_.end(),
                       [](const auto& a, const auto& b) { return a.second < b.second; });
  const ComponentId component = most->first;
  const std::vector<SubmapId> ids = model_.SubmapsOf(component);
  if (IsLarge(component)) {
    // It outgrew its kind.
    const int urgency = most->second;
    stale_.erase(most);
    for (const SubmapId id : ids) MarkStale(id, urgency);
    AdjustRegion(interrupt);
    return;
  }
  PositionReferences positions;
  const bool has_positions = Georeference(component, &positions);
  if (has_positions && !BendToPositions(component, interrupt, &positions)) return;
  MakeMetric(component);
  const MapAdjustment adjustment = AdjustMap(options_.adjuster, ids, 2, &interrupt, &model_,
                                             has_positions ? &positions : nullptr);
  Touch(ids);
  ReportErrors(component);
  if (adjustment.summary.interrupted) return;
  // If some are put back the component stays stale.
  if (PutBackStrays(ids)) return;
  stale_.erase(component);
  unsettled_.insert(component);
  MakeMetric(component);
  ReviseClosures(component);
}

bool MapAligner::Survives(const Closure& closure) const {
  const auto seen = [](const ModelSubmap& submap, int landmark) {
    const std::span<const ModelSight> sights = submap.sights[landmark];
    return std::any_of(sights.begin(), sights.end(),
                       [](const ModelSight& sight) { return sight.inlier; });
  };
  const ModelSubmap& a = model_.submap(closure.a);
  const ModelSubmap& b = model_.submap(closure.b);
  int surviving = 0;
  for (const LandmarkMatch& match : closure.matches) {
    const int in_a = MapModel::LandmarkIndex(*a.refined, match.in_a);
    const int in_b = MapModel::LandmarkIndex(*b.refined, match.in_b);
    if (in_a < 0 || in_b < 0 || a.landmarks[in_a] != b.landmarks[in_b]) continue;
    if (seen(a, in_a) && seen(b, in_b)) ++surviving;
  }
  return surviving >= options_.min_surviving_matches * static_cast<double>(closure.matches.size());
}

void MapAligner::ReviseClosures(ComponentId component) {
  DropFailedClosures(component);
  if (!stale_.contains(component)) CloseLoops(component);
}

void MapAligner::DropFailedClosures(ComponentId component) {
  std::set<const Closure*> failed;
  std::vector<std::shared_ptr<const Closure>> again;
  for (size_t i = 0; i < closures().size(); ++i) {
    const std::shared_ptr<const Closure>& closure = closures().shared(i);
    if (model_.submap(closure->a).component != component || Survives(*closure)) continue;
    failed.insert(closure.get());
    // What fails may be right and another one wrong that bends the map: it gets a second chance.
    if (failed_once_.emplace(closure->a, closure->b).second) again.push_back(closure);
  }
  if (failed.empty()) return;
  relations_.EraseClosures([&](const Closure& closure) { return failed.contains(&closure); });
  PartComponent(component);
  SettleWaiting();
  for (auto& closure : again) pending_.push_back(std::move(closure));
}

// After closures were taken back: landmarks come apart, and so does what is no longer connected.
void MapAligner::PartComponent(ComponentId component) {
  CancelRelaxation(component);
  const std::vector<SubmapId> ids = model_.SubmapsOf(component);
  model_.SeparateLandmarks(ids);
  for (const Closure& closure : closures()) {
    if (model_.submap(closure.a).component == component) UniteMatches(closure);
  }
  std::set<SubmapId> left(ids.begin(), ids.end());
  while (!left.empty()) {
    const ComponentId name(left.begin()->value());
    std::vector<SubmapId> part = {*left.begin()};
    left.erase(left.begin());
    for (size_t i = 0; i < part.size(); ++i) {
      for (const SubmapId neighbour : relations_.NeighbourNames(model_, part[i])) {
        if (left.erase(neighbour) > 0) part.push_back(neighbour);
      }
    }
    model_.NamePart(part, name);
    if (name != component && IsGeoreferenced(component)) {
      georeferences_[name] = georeferences_.at(component);
    }
    relations_.Rechain(model_, part);
    MarkStale(part.front(), 2);
    Touch(part);
  }
}

void MapAligner::MakeMetric(ComponentId component) {
  if (IsGeoreferenced(component)) return;
  const Similarity3 metric_from_world =
      MetricFromWorld(options_.adjuster.metric, model_, model_.SubmapsOf(component));
  if (metric_from_world.scale == 1 && metric_from_world.rotation.w() == 1) return;
  CancelRelaxation(component);
  model_.MoveComponent(component, component, metric_from_world);
  TouchComponent(component);
}

void MapAligner::TouchComponent(ComponentId component) { Touch(model_.SubmapsOf(component)); }

// With the submaps that own the landmarks seen in the window.
void MapAligner::Touch(const std::vector<SubmapId>& window) {
  for (const SubmapId id : window) {
    touched_.insert(id);
    for (const int landmark : model_.submap(id).landmarks) {
      touched_.insert(model_.landmarks()[landmark].sights.front().submap);
    }
  }
}

void MapAligner::MarkStale(SubmapId id, int urgency) {
  const ComponentId component = model_.submap(id).component;
  int& present = IsLarge(component) ? restless_[id] : stale_[component];
  present = std::max(present, urgency);
}

std::set<SubmapId> MapAligner::TakeTouched() { return std::exchange(touched_, {}); }

std::set<SubmapId> MapAligner::TakeMoved() { return std::exchange(moved_, {}); }

std::map<SubmapId, std::set<TrackId>> MapAligner::TakeTouchedLandmarks() {
  return std::exchange(touched_landmarks_, {});
}

}  // namespace portolan
