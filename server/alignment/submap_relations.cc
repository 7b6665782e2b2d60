#include "server/alignment/submap_relations.h"

#include <algorithm>
#include <deque>
#include <utility>

#include "common/linear_algebra/dense.h"

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

// Covariance of the right perturbation of the inverse of `transform`.
Matrix7d CovarianceOfInverse(const Similarity3& transform, const Matrix7d& covariance) {
  const Matrix7d adjoint = transform.Adjoint();
  return Congruence(adjoint, covariance);
}

// Of the chain that goes on from one submap to its neighbour.
Matrix7d Continued(const Matrix7d& covariance, const SubmapRelations::Neighbour& neighbour) {
  const Matrix7d adjoint = neighbour.from_neighbour.Inverse().Adjoint();
  return Congruence(adjoint, covariance) + neighbour.covariance;
}

}  // namespace

Status SubmapRelationsOptions::Validate() const {
  if (!(closure_translation_floor_of_depth > 0) || !(closure_rotation_floor_rad > 0) ||
      !(closure_log_scale_floor > 0) || max_chain_search < 1) {
    return absl::InvalidArgumentError("submap relations: limits out of range");
  }
  return absl::OkStatus();
}

const std::vector<size_t>& SubmapRelations::ClosuresOf(SubmapId id) const {
  static const std::vector<size_t> kNone;
  const auto found = closures_of_.find(id);
  return found == closures_of_.end() ? kNone : found->second;
}

Matrix7d SubmapRelations::FlooredCovariance(const MapModel& model, const Closure& closure) const {
  Matrix7d covariance = InverseOfPositiveDefinite(closure.information);
  const double translation =
      options_.closure_translation_floor_of_depth * MedianRange(*model.submap(closure.b).refined);
  covariance.diagonal().head<3>().array() += translation * translation;
  covariance.diagonal().segment<3>(3).array() +=
      options_.closure_rotation_floor_rad * options_.closure_rotation_floor_rad;
  covariance(6, 6) += options_.closure_log_scale_floor * options_.closure_log_scale_floor;
  return covariance;
}

void SubmapRelations::AddSubmap(const MapModel& model, SubmapId id) {
  const auto& link = model.submap(id).link;
  chains_.erase(id);
  if (link && chains_.contains(link->a)) {
    Propagate(model, {link->a});
  }
  chains_.try_emplace(id);
}

void SubmapRelations::AddClosure(const MapModel& model, std::shared_ptr<const Closure> closure) {
  closures_of_[closure->a].push_back(closures_.size());
  closures_of_[closure->b].push_back(closures_.size());
  covariances_.push_back(FlooredCovariance(model, *closure));
  closures_.push_back(closure);
  Propagate(model, {closure->a, closure->b});
}

void SubmapRelations::EraseClosures(const std::function<bool(const Closure&)>& predicate) {
  ClosureList kept;
  std::vector<Matrix7d> covariances;
  closures_of_.clear();
  for (size_t i = 0; i < closures_.size(); ++i) {
    if (predicate(closures_[i])) continue;
    closures_of_[closures_[i].a].push_back(kept.size());
    closures_of_[closures_[i].b].push_back(kept.size());
    kept.push_back(closures_.shared(i));
    covariances.push_back(covariances_[i]);
  }
  closures_ = std::move(kept);
  covariances_ = std::move(covariances);
}

void SubmapRelations::Rechain(const MapModel& model, const std::vector<SubmapId>& submaps) {
  for (const SubmapId id : submaps) chains_.erase(id);
  std::vector<SubmapId> front;
  for (const SubmapId id : submaps) {
    if (model.submap(id).component == ComponentId(id.value())) {
      chains_[id] = Chain();
      front.push_back(id);
    }
    for (const SubmapId neighbour : NeighbourNames(model, id)) {
      if (chains_.contains(neighbour)) front.push_back(neighbour);
    }
  }
  Propagate(model, std::move(front));
  for (const SubmapId id : submaps) chains_.try_emplace(id);
}

void SubmapRelations::Propagate(const MapModel& model, std::vector<SubmapId> front) {
  // Nearest first, so that no chain is written twice in the common case.
  std::erase_if(front, [&](SubmapId id) { return !chains_.contains(id); });
  std::stable_sort(front.begin(), front.end(), [&](SubmapId a, SubmapId b) {
    return chains_.at(a).length < chains_.at(b).length;
  });
  std::deque<SubmapId> queue(front.begin(), front.end());
  while (!queue.empty()) {
    const SubmapId id = queue.front();
    queue.pop_front();
    const Chain chain = chains_.at(id);
    for (const SubmapId name : NeighbourNames(model, id)) {
      const auto known = chains_.find(name);
      if (known != chains_.end() && known->second.length <= chain.length + 1) continue;
      for (const Neighbour& neighbour : NeighboursOf(model, id)) {
        if (neighbour.submap != name) continue;
        chains_[name] = {chain.length + 1, Continued(chain.covariance, neighbour)};
        break;
      }
      queue.push_back(name);
    }
  }
}

std::vector<SubmapRelations::Neighbour> SubmapRelations::NeighboursOf(const MapModel& model,
                                                                      SubmapId id) const {
  std::vector<Neighbour> neighbours;
  const ModelSubmap& submap = model.submap(id);
  const auto relative = [&](SubmapId from) {
    return submap.world_from_submap.Inverse() * model.submap(from).world_from_submap;
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
  if (submap.link) add(submap.link->a, id, InverseOfPositiveDefinite(submap.link->information));
  if (submap.successor) {
    add(id, *submap.successor,
        InverseOfPositiveDefinite(model.submap(*submap.successor).link->information));
  }
  for (const size_t i : ClosuresOf(id)) add(closures_[i].a, closures_[i].b, covariances_[i]);
  return neighbours;
}

std::vector<SubmapId> SubmapRelations::NeighbourNames(const MapModel& model, SubmapId id) const {
  std::vector<SubmapId> names;
  const ModelSubmap& submap = model.submap(id);
  if (submap.link) names.push_back(submap.link->a);
  if (submap.successor) names.push_back(*submap.successor);
  for (const size_t i : ClosuresOf(id)) {
    names.push_back(closures_[i].a == id ? closures_[i].b : closures_[i].a);
  }
  return names;
}

std::optional<UncertainSimilarity> SubmapRelations::Relative(const MapModel& model, SubmapId a,
                                                             SubmapId b) const {
  if (model.submap(a).component != model.submap(b).component) return std::nullopt;
  // The way there is found by names alone; covariances are added along it afterwards.
  std::unordered_map<SubmapId, SubmapId> before = {{a, a}};
  std::deque<SubmapId> front = {a};
  while (!front.empty() && !before.contains(b)) {
    if (before.size() > static_cast<size_t>(options_.max_chain_search)) return std::nullopt;
    const SubmapId id = front.front();
    front.pop_front();
    for (const SubmapId name : NeighbourNames(model, id)) {
      if (before.emplace(name, id).second) front.push_back(name);
    }
  }
  if (!before.contains(b)) return std::nullopt;
  std::vector<SubmapId> way = {b};
  while (way.back() != a) way.push_back(before.at(way.back()));
  Matrix7d covariance = Matrix7d::Zero();
  for (size_t i = way.size() - 1; i > 0; --i) {
    for (const Neighbour& neighbour : NeighboursOf(model, way[i])) {
      if (neighbour.submap != way[i - 1]) continue;
      covariance = Continued(covariance, neighbour);
      break;
    }
  }
  return UncertainSimilarity{
      model.submap(a).world_from_submap.Inverse() * model.submap(b).world_from_submap, covariance};
}

Matrix7d SubmapRelations::Covariance(SubmapId id) const {
  const auto chain = chains_.find(id);
  return chain == chains_.end() ? Matrix7d::Zero() : chain->second.covariance;
}

}  // namespace portolan
