// Closures inside of large components: which to accept, and what they move.
#include <algorithm>
#include <cstdint>
#include <limits>
#include <memory>

#include "common/linear_algebra/dense.h"
#include "server/alignment/map_aligner.h"

namespace portolan {
namespace {

// Squared strain, in sigmas, of a relation at the rim of a region above which the region was too
// small.
constexpr double kMaxRimChi2 = 1.0;

// Were the rim free, the strain at it would spread over more relations beyond: the cost may fall by
// so many times the strain at the rim. What contradicts by more than that is taken to contradict
// whatever the region's size. A rule of thumb, not a bound: of 10, 30 and 100 the replayed town of
// 3,000 submaps (tests/benchmark/replay) got too bent with 10.
constexpr double kMaxReliefOfRim = 30.0;

// Relative decrease of a region's cost under which it has converged.
constexpr double kMinRegionDecrease = 1e-2;

// Of a closure that was never judged.
constexpr double kUnjudged = std::numeric_limits<double>::infinity();

// A closure that was refused is judged again when it contradicts the map by less than this share
// of what it did: most never will be right, and each costs the solution of a large region.
constexpr double kNewHope = 0.5;

// Submaps whose credit can be saved up.
constexpr int64_t kMaxSavedCredits = 40;

double Chi2Of(const Relation& relation, const RelationGraph& graph) {
  const Vector7d error = RelationError(relation.a_from_b, graph.world_from_node[relation.a],
                                       graph.world_from_node[relation.b]);
  return error.dot(relation.information * error);
}

}  // namespace

double MapAligner::Disagreement(const Closure& closure) const {
  const Vector7d error = RelationError(closure.a_from_b, model_.submap(closure.a).world_from_submap,
                                       model_.submap(closure.b).world_from_submap);
  return NormalisedSquare(error, relations_.FlooredCovariance(model_, closure));
}

std::optional<double> MapAligner::DisagreementAlongChain(const Closure& closure) const {
  const auto chain = Relative(closure.a, closure.b);
  if (!chain) return std::nullopt;
  const Vector7d error = RelationError(closure.a_from_b, model_.submap(closure.a).world_from_submap,
                                       model_.submap(closure.b).world_from_submap);
  const Matrix7d covariance = chain->covariance + relations_.FlooredCovariance(model_, closure);
  return NormalisedSquare(error, covariance);
}

// The strongest first: once it has put the submap right, the others mostly agree.
bool MapAligner::CloseLoopsLocally(std::vector<std::shared_ptr<const Closure>> candidates) {
  std::erase_if(candidates, [this](const auto& closure) { return seen_.contains(closure.get()); });
  std::stable_sort(candidates.begin(), candidates.end(), [](const auto& a, const auto& b) {
    return a->matches.size() > b->matches.size();
  });
  bool closed = false;
  for (const auto& closure : candidates) {
    seen_[closure.get()] = kUnjudged;
    const bool may_solve = solving_credit_ > 0;
    if (AcceptIfItAgrees(closure, may_solve)) {
      closed = true;
    } else if (!may_solve) {
      unjudged_.push_back(closure);
    }
  }
  return closed;
}

bool MapAligner::AcceptIfItAgrees(const std::shared_ptr<const Closure>& closure, bool may_solve) {
  const double disagreement = Disagreement(*closure);
  bool agrees = disagreement <= options_.graph.max_chi2;
  if (!agrees && may_solve) {
    const std::optional<double> along_chain = DisagreementAlongChain(*closure);
    agrees = (!along_chain || *along_chain <= options_.graph.max_chi2) && SolveAround(*closure);
    seen_[closure.get()] = disagreement;
  }
  if (!agrees) return false;
  Accept(closure);
  ErasePending([&](const Closure& waiting) { return &waiting == closure.get(); });
  return true;
}

void MapAligner::EarnSolvingCredit() {
  solving_credit_ = std::min<int64_t>(solving_credit_ + options_.solving_credit_submaps,
                                      kMaxSavedCredits * options_.solving_credit_submaps);
}

bool MapAligner::HasMuchCredit() const {
  return 2 * solving_credit_ > kMaxSavedCredits * options_.solving_credit_submaps;
}

void MapAligner::JudgeUnjudged(const std::function<bool()>& may_go_on) {
  while (!unjudged_.empty() && may_go_on()) {
    const std::shared_ptr<const Closure> closure = unjudged_.front();
    unjudged_.pop_front();
    if (!seen_.contains(closure.get())) continue;
    if (model_.submap(closure->a).component == model_.submap(closure->b).component) {
      AcceptIfItAgrees(closure, true);
    } else {
      // Its ends came apart. Should they join again, it is judged like a new one.
      seen_.erase(closure.get());
    }
  }
}

void MapAligner::JudgeAgain(ComponentId component) {
  const auto is_inside = [&](const Closure& closure) {
    return model_.submap(closure.a).component == component &&
           model_.submap(closure.b).component == component;
  };
  std::vector<std::shared_ptr<const Closure>> waiting;
  for (size_t i = 0; i < pending_.size(); ++i) {
    if (seen_.contains(&pending_[i]) && is_inside(pending_[i])) {
      waiting.push_back(pending_.shared(i));
    }
  }
  std::erase_if(unjudged_, [&](const auto& closure) { return is_inside(*closure); });
  for (const auto& closure : waiting) {
    if (AcceptIfItAgrees(closure, false)) continue;
    if (Disagreement(*closure) < kNewHope * seen_.at(closure.get())) unjudged_.push_back(closure);
  }
}

bool MapAligner::SolveAround(const Closure& closure) {
  size_t count = options_.loop_region_submaps;
  while (true) {
    const std::vector<SubmapId> region = RegionAround({closure.a, closure.b}, count);
    solving_credit_ -= static_cast<int64_t>(region.size());
    const RegionOutcome outcome = SolveRegion(closure, region);
    if (outcome != RegionOutcome::kTooSmall) return outcome == RegionOutcome::kSolved;
    count = std::min<size_t>(4 * count, options_.max_loop_region_submaps);
  }
}

// Every relation is measured as the map has it, so that what the adjustments gained stays; the
// closure is the only one that pulls, and the cost of the solution is how far it contradicts.
MapAligner::RegionOutcome MapAligner::SolveRegion(const Closure& closure,
                                                  const std::vector<SubmapId>& region) {
  std::map<SubmapId, int> nodes;
  for (const SubmapId id : region) nodes.emplace(id, static_cast<int>(nodes.size()));
  RelationGraph graph;
  graph.fixed.assign(region.size(), false);
  bool has_rim = false;
  const auto add = [&](SubmapId a, SubmapId b, const Matrix7d& information) {
    const Similarity3 a_from_b =
        model_.submap(a).world_from_submap.Inverse() * model_.submap(b).world_from_submap;
    graph.relations.push_back({nodes.at(a), nodes.at(b), a_from_b, information, false});
  };
  for (const SubmapId id : region) {
    const ModelSubmap& submap = model_.submap(id);
    graph.world_from_node.push_back(submap.world_from_submap);
    if (submap.link && nodes.contains(submap.link->a)) {
      add(submap.link->a, id, submap.link->information);
    }
    for (const size_t i : relations_.ClosuresOf(id)) {
      const Closure& other = closures()[i];
      if (other.b == id && nodes.contains(other.a)) {
        add(other.a, id, InverseOfPositiveDefinite(relations_.CovarianceOf(i)));
      }
    }
    for (const SubmapId neighbour : relations_.NeighbourNames(model_, id)) {
      if (nodes.contains(neighbour)) continue;
      graph.fixed[nodes.at(id)] = true;
      has_rim = true;
    }
  }
  const size_t oldest =
      static_cast<size_t>(std::min_element(region.begin(), region.end()) - region.begin());
  if (!has_rim) graph.fixed[oldest] = true;
  const bool is_largest =
      !has_rim || region.size() >= static_cast<size_t>(options_.max_loop_region_submaps);
  graph.relations.push_back(
      {nodes.at(closure.a), nodes.at(closure.b), closure.a_from_b,
       InverseOfPositiveDefinite(relations_.FlooredCovariance(model_, closure)), false});
  // The adjustments that follow do the rest.
  RelationGraphOptions coarse = options_.graph;
  coarse.min_decrease = kMinRegionDecrease;
  SolveRelationGraph(coarse, &graph);
  double cost = 0;
  double rim = 0;
  double rim_sum = 0;
  for (const Relation& relation : graph.relations) {
    const double chi2 = Chi2Of(relation, graph);
    cost += chi2;
    if (!has_rim || !(graph.fixed[relation.a] || graph.fixed[relation.b])) continue;
    rim = std::max(rim, chi2);
    rim_sum += chi2;
  }
  const double excess = cost - options_.graph.max_chi2;
  const bool contradicts = !(excess <= 0);
  const bool may_relent = !(excess > kMaxReliefOfRim * rim_sum);
  if (!is_largest && (contradicts ? may_relent : rim > kMaxRimChi2)) {
    return RegionOutcome::kTooSmall;
  }
  if (contradicts) return RegionOutcome::kContradicts;
  if (!has_rim) KeepUnitOf(region, oldest, &graph.world_from_node);
  MoveRegion(region, graph.world_from_node);
  return RegionOutcome::kSolved;
}

}  // namespace portolan
