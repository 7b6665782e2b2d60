#include "server/alignment/map_aligner.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <deque>
#include <utility>

namespace portolan {
namespace {

double MedianRange(const RefinedSubmap& submap) {
  std::vector<double> ranges;
  for (const RefinedLandmark& landmark : submap.landmarks) {
    ranges.push_back(landmark.point_in_submap.norm());
  }
  if (ranges.empty()) return 1.0;
  std::nth_element(ranges.begin(), ranges.begin() + ranges.size() / 2, ranges.end());
  return ranges[ranges.size() / 2];
}

Matrix7d Inverse(const Matrix7d& positive_definite) {
  const Matrix7d inverse = positive_definite.llt().solve(Matrix7d::Identity());
  return 0.5 * (inverse + inverse.transpose());
}

// Covariance of the right perturbation of the inverse of `transform`.
Matrix7d CovarianceOfInverse(const Similarity3& transform, const Matrix7d& covariance) {
  const Matrix7d adjoint = transform.Adjoint();
  return adjoint * covariance * adjoint.transpose();
}

}  // namespace

Status MapAlignerOptions::Validate() const {
  PORTOLAN_RETURN_IF_ERROR(model.Validate());
  PORTOLAN_RETURN_IF_ERROR(link.Validate());
  PORTOLAN_RETURN_IF_ERROR(adjuster.Validate());
  PORTOLAN_RETURN_IF_ERROR(graph.Validate());
  PORTOLAN_RETURN_IF_ERROR(consistency.Validate());
  if (min_matches_of_single_closure < 1 || !(closure_translation_floor_of_depth > 0) ||
      !(closure_rotation_floor_rad > 0) || !(closure_log_scale_floor > 0) ||
      !(min_surviving_matches >= 0 && min_surviving_matches <= 1) || window_predecessors < 0 ||
      window_closures < 0 || local_iterations < 1 || max_pending < 0) {
    return absl::InvalidArgumentError("map aligner: limits out of range");
  }
  return absl::OkStatus();
}

MapAligner::MapAligner(const MapAlignerOptions& options)
    : options_(options), model_(options.model) {}

void MapAligner::RestoreSubmap(const PlacedSubmap& placed) {
  const SubmapId id = placed.refined->id;
  model_.Restore(placed, LinkOf(*placed.refined));
  id_of_key_[placed.refined->raw->key] = id;
  if (!model_.submap(id).quarantined()) MarkStale(placed.component, 1);
}

void MapAligner::RestoreClosure(const Closure& closure) {
  if (model_.Contains(closure.a) && model_.Contains(closure.b)) Accept(closure);
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

void MapAligner::RestoreWaitingClosure(const Closure& closure) {
  if (model_.Contains(closure.a) && model_.Contains(closure.b)) pending_.push_back(closure);
}

void MapAligner::AddSubmap(std::shared_ptr<const RefinedSubmap> refined) {
  const SubmapId id = refined->id;
  id_of_key_[refined->raw->key] = id;
  const std::optional<SubmapRelation> link = LinkOf(*refined);
  model_.Add(std::move(refined), link);
  Touch({id});
  if (!model_.submap(id).quarantined()) MarkStale(model_.submap(id).component, 1);
}

void MapAligner::AddClosures(const std::vector<Closure>& closures) {
  if (closures.empty()) return;
  for (const Closure& closure : closures) {
    if (model_.Contains(closure.a) && model_.Contains(closure.b)) pending_.push_back(closure);
  }
  // A join turns other closures into loops, and a corrected loop may let others agree.
  while (JoinComponents()) CloseLoops();
  CloseLoops();
  if (pending_.size() > static_cast<size_t>(options_.max_pending)) {
    pending_.erase(pending_.begin(), pending_.end() - options_.max_pending);
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
  for (const auto& [components, closures] : groups) {
    std::vector<Closure> agreeing;
    for (const size_t i : LargestConsistentSet(closures, relative, options_.consistency)) {
      agreeing.push_back(closures[i]);
    }
    const bool single = agreeing.size() == 1 && static_cast<int>(agreeing[0].matches.size()) >=
                                                    options_.min_matches_of_single_closure;
    if (agreeing.size() < 2 && !single) continue;
    Join(agreeing);
    return true;
  }
  return false;
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
  if (in_a < in_b) {
    model_.MoveComponent(in_b, in_a, a_world_from_b_world);
  } else {
    model_.MoveComponent(in_a, in_b, a_world_from_b_world.Inverse());
  }
  std::erase_if(pending_,
                [&](const Closure& closure) { return closure.a == best.a && closure.b == best.b; });
  Accept(best);
  TouchComponent(std::min(in_a, in_b));
}

// Solves the graph of each component that has waiting closures; those that fit are accepted. Links
// and accepted closures enter as the map has them now, so that what the adjustments gained stays.
bool MapAligner::CloseLoops() {
  std::map<ComponentId, std::vector<size_t>> loops;
  for (size_t i = 0; i < pending_.size(); ++i) {
    const ComponentId component = model_.submap(pending_[i].a).component;
    if (component == model_.submap(pending_[i].b).component) loops[component].push_back(i);
  }
  std::set<size_t> closed;
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
    for (const Closure& closure : accepted_) {
      if (nodes.contains(closure.a)) {
        add(closure.a, closure.b, Inverse(FlooredCovariance(closure)));
      }
    }
    const size_t first = graph.relations.size();
    for (const size_t i : candidates) {
      const Closure& closure = pending_[i];
      graph.relations.push_back({nodes.at(closure.a), nodes.at(closure.b), closure.a_from_b,
                                 Inverse(FlooredCovariance(closure)), true});
    }
    const std::vector<double> weights = SolveRelationGraph(options_.graph, &graph);
    const size_t before = closed.size();
    for (size_t i = 0; i < candidates.size(); ++i) {
      if (weights[first + i] > 0.5) closed.insert(candidates[i]);
    }
    if (closed.size() == before) continue;
    for (const SubmapId id : ids) model_.MoveSubmap(id, graph.world_from_node[nodes.at(id)]);
    TouchComponent(component);
  }
  std::vector<Closure> waiting;
  std::vector<Closure> now;
  for (size_t i = 0; i < pending_.size(); ++i) {
    (closed.contains(i) ? now : waiting).push_back(pending_[i]);
  }
  pending_ = std::move(waiting);
  for (const Closure& closure : now) Accept(closure);
  return !now.empty();
}

void MapAligner::Accept(const Closure& closure) {
  closures_of_[closure.a].push_back(accepted_.size());
  closures_of_[closure.b].push_back(accepted_.size());
  accepted_.push_back(closure);
  UniteMatches(closure);
  MarkStale(model_.submap(closure.a).component, 2);
}

void MapAligner::UniteMatches(const Closure& closure) {
  for (const LandmarkMatch& match : closure.matches) {
    model_.UniteLandmarks({closure.a, match.in_a}, {closure.b, match.in_b});
  }
}

Matrix7d MapAligner::FlooredCovariance(const Closure& closure) const {
  Matrix7d covariance = Inverse(closure.information);
  const double translation =
      options_.closure_translation_floor_of_depth * MedianRange(*model_.submap(closure.b).refined);
  covariance.diagonal().head<3>().array() += translation * translation;
  covariance.diagonal().segment<3>(3).array() +=
      options_.closure_rotation_floor_rad * options_.closure_rotation_floor_rad;
  covariance(6, 6) += options_.closure_log_scale_floor * options_.closure_log_scale_floor;
  return covariance;
}

std::vector<MapAligner::Neighbour> MapAligner::NeighboursOf(SubmapId id) const {
  std::vector<Neighbour> neighbours;
  const ModelSubmap& submap = model_.submap(id);
  const auto relative = [&](SubmapId from) {
    return submap.world_from_submap.Inverse() * model_.submap(from).world_from_submap;
  };
  // `covariance` belongs to a_from_b.
  const auto add = [&](SubmapId a, SubmapId b, const Matrix7d& covariance) {
    if (id == a) {
      neighbours.push_back({b, relative(b), covariance});
    } else {
      const Similarity3 from_a = relative(a);
      neighbours.push_back({a, from_a, CovarianceOfInverse(from_a.Inverse(), covariance)});
    }
  };
  if (submap.link) add(submap.link->a, id, Inverse(submap.link->information));
  if (submap.successor) {
    add(id, *submap.successor, Inverse(model_.submap(*submap.successor).link->information));
  }
  const auto closures = closures_of_.find(id);
  if (closures == closures_of_.end()) return neighbours;
  for (const size_t i : closures->second) {
    add(accepted_[i].a, accepted_[i].b, FlooredCovariance(accepted_[i]));
  }
  return neighbours;
}

// Along the chain with the fewest members.
std::optional<UncertainSimilarity> MapAligner::Relative(SubmapId a, SubmapId b) const {
  if (model_.submap(a).component != model_.submap(b).component) return std::nullopt;
  std::map<SubmapId, Matrix7d> covariances = {{a, Matrix7d::Zero()}};
  std::deque<SubmapId> front = {a};
  while (!front.empty() && !covariances.contains(b)) {
    const SubmapId id = front.front();
    front.pop_front();
    for (const Neighbour& neighbour : NeighboursOf(id)) {
      if (covariances.contains(neighbour.submap)) continue;
      const Matrix7d adjoint = neighbour.from_neighbour.Inverse().Adjoint();
      covariances[neighbour.submap] =
          adjoint * covariances.at(id) * adjoint.transpose() + neighbour.covariance;
      front.push_back(neighbour.submap);
    }
  }
  if (!covariances.contains(b)) return std::nullopt;
  return UncertainSimilarity{
      model_.submap(a).world_from_submap.Inverse() * model_.submap(b).world_from_submap,
      covariances.at(b)};
}

Matrix7d MapAligner::Covariance(SubmapId id) const {
  const SubmapId oldest(model_.submap(id).component.value());
  const std::optional<UncertainSimilarity> relative = Relative(oldest, id);
  return relative ? relative->covariance : Matrix7d::Zero();
}

void MapAligner::AdjustAround(SubmapId id) {
  if (model_.submap(id).quarantined()) return;
  MakeMetric(model_.submap(id).component);
  std::set<SubmapId> window = {id};
  SubmapId predecessor = id;
  for (int i = 0; i < options_.window_predecessors && model_.submap(predecessor).link; ++i) {
    predecessor = model_.submap(predecessor).link->a;
    window.insert(predecessor);
  }
  const auto closures = closures_of_.find(id);
  if (closures != closures_of_.end()) {
    std::vector<size_t> order = closures->second;
    std::stable_sort(order.begin(), order.end(), [this](size_t a, size_t b) {
      return accepted_[a].matches.size() > accepted_[b].matches.size();
    });
    if (order.size() > static_cast<size_t>(options_.window_closures)) {
      order.resize(options_.window_closures);
    }
    for (const size_t i : order) window.insert({accepted_[i].a, accepted_[i].b});
  }
  MapAdjusterOptions local = options_.adjuster;
  local.bundle.max_iterations = options_.local_iterations;
  const std::vector<SubmapId> ids(window.begin(), window.end());
  last_adjustment_ = AdjustMap(local, ids, 1, nullptr, &model_);
  Touch(ids);
}

void MapAligner::AdjustStaleComponent(const std::atomic<bool>& interrupt) {
  if (stale_.empty()) return;
  const auto most =
      std::max_element(stale_.begin(), stale_.end(),
                       [](const auto& a, const auto& b) { return a.second < b.second; });
  const ComponentId component = most->first;
  MakeMetric(component);
  const std::vector<SubmapId> ids = model_.SubmapsOf(component);
  last_adjustment_ = AdjustMap(options_.adjuster, ids, 2, &interrupt, &model_);
  Touch(ids);
  if (last_adjustment_.summary.interrupted) return;
  stale_.erase(component);
  MakeMetric(component);
  DropFailedClosures(component);
}

bool MapAligner::Survives(const Closure& closure) const {
  const auto seen = [](const ModelSubmap& submap, int landmark) {
    const std::vector<ModelSight>& sights = submap.sights[landmark];
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

void MapAligner::DropFailedClosures(ComponentId component) {
  const size_t before = accepted_.size();
  std::erase_if(accepted_, [&](const Closure& closure) {
    return model_.submap(closure.a).component == component && !Survives(closure);
  });
  if (accepted_.size() == before) return;
  closures_of_.clear();
  for (size_t i = 0; i < accepted_.size(); ++i) {
    closures_of_[accepted_[i].a].push_back(i);
    closures_of_[accepted_[i].b].push_back(i);
  }
  PartComponent(component);
}

// After closures were taken back: landmarks come apart, and so does what is no longer connected.
void MapAligner::PartComponent(ComponentId component) {
  const std::vector<SubmapId> ids = model_.SubmapsOf(component);
  model_.SeparateLandmarks(ids);
  for (const Closure& closure : accepted_) {
    if (model_.submap(closure.a).component == component) UniteMatches(closure);
  }
  std::set<SubmapId> left(ids.begin(), ids.end());
  while (!left.empty()) {
    const ComponentId name(left.begin()->value());
    std::vector<SubmapId> part = {*left.begin()};
    left.erase(left.begin());
    for (size_t i = 0; i < part.size(); ++i) {
      for (const Neighbour& neighbour : NeighboursOf(part[i])) {
        if (left.erase(neighbour.submap) > 0) part.push_back(neighbour.submap);
      }
    }
    model_.NamePart(part, name);
    MarkStale(name, 2);
    Touch(part);
  }
}

void MapAligner::MakeMetric(ComponentId component) {
  const Similarity3 metric_from_world =
      MetricFromWorld(options_.adjuster.metric, model_, model_.SubmapsOf(component));
  if (metric_from_world.scale == 1 && metric_from_world.rotation.w() == 1) return;
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

void MapAligner::MarkStale(ComponentId component, int urgency) {
  int& present = stale_[component];
  present = std::max(present, urgency);
}

std::set<SubmapId> MapAligner::TakeTouched() { return std::exchange(touched_, {}); }

}  // namespace portolan
