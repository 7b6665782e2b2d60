#include "server/verification/pairwise_consistency.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

#include "common/linear_algebra/dense.h"

namespace portolan {
namespace {

std::optional<UncertainSimilarity> RelationOf(const Closure& closure) {
  Matrix7d covariance = Matrix7d::Identity();
  if (!SolvePositiveDefinite(closure.information, covariance)) return std::nullopt;
  return UncertainSimilarity{closure.a_from_b, covariance};
}

// (S Exp(d))^-1 = S^-1 Exp(-Ad_S d).
UncertainSimilarity Inverse(const UncertainSimilarity& relation) {
  const Matrix7d adjoint = relation.a_from_b.Adjoint();
  return {relation.a_from_b.Inverse(), Congruence(adjoint, relation.covariance)};
}

// S Exp(d) T Exp(e) = S T Exp(Ad_T^-1 d) Exp(e), d and e independent.
UncertainSimilarity Compose(const UncertainSimilarity& first, const UncertainSimilarity& second) {
  const Matrix7d adjoint = second.a_from_b.Inverse().Adjoint();
  return {first.a_from_b * second.a_from_b,
          Congruence(adjoint, first.covariance) + second.covariance};
}

Matrix7d FloorCovariance(double length, const PairwiseConsistencyOptions& options) {
  Vector7d sigma;
  sigma.head<3>().setConstant(options.translation_floor * length);
  sigma.segment<3>(3).setConstant(options.rotation_floor_rad);
  sigma[6] = options.log_scale_floor;
  return sigma.cwiseAbs2().asDiagonal();
}

// Largest translation in the loop, in units of its base frame a1.
double LengthOf(const UncertainSimilarity& first, const UncertainSimilarity& in_b,
                const UncertainSimilarity& second, const UncertainSimilarity& in_a) {
  const double scale = first.a_from_b.scale;
  return std::max({first.a_from_b.translation.norm(), scale * in_b.a_from_b.translation.norm(),
                   in_a.a_from_b.translation.norm(),
                   in_a.a_from_b.scale * second.a_from_b.translation.norm()});
}

std::optional<double> OrientedLoop(const UncertainSimilarity& first,
                                   const UncertainSimilarity& second, SubmapId a1, SubmapId b1,
                                   SubmapId a2, SubmapId b2, const RelativeSimilarity& relative,
                                   const PairwiseConsistencyOptions& options) {
  const auto a1_from_a2 = relative(a1, a2);
  const auto b1_from_b2 = relative(b1, b2);
  if (!a1_from_a2 || !b1_from_b2) return std::nullopt;
  // a1 <- b1 <- b2 <- a2 <- a1.
  const UncertainSimilarity loop =
      Compose(Compose(Compose(first, *b1_from_b2), Inverse(second)), Inverse(*a1_from_a2));
  const Vector7d error = loop.a_from_b.Log();
  const Matrix7d covariance =
      loop.covariance + FloorCovariance(LengthOf(first, *b1_from_b2, second, *a1_from_a2), options);
  const double distance = NormalisedSquare(error, covariance);
  if (!std::isfinite(distance)) return std::nullopt;
  return distance;
}

// Maximum clique by branch and bound with greedy colouring (Tomita & Seki, DMTCS 2003).
class CliqueSearch {
 public:
  CliqueSearch(const std::vector<std::vector<bool>>& adjacent, std::vector<size_t> weights,
               int max_branches)
      : adjacent_(adjacent), weights_(std::move(weights)), branches_left_(max_branches) {}

  std::vector<size_t> Run() {
    std::vector<size_t> all(adjacent_.size());
    for (size_t i = 0; i < all.size(); ++i) all[i] = i;
    for (const size_t start : all) Consider(GrowGreedily(start));
    std::vector<size_t> clique;
    Expand(all, &clique);
    return best_;
  }

 private:
  std::vector<size_t> Neighbours(const std::vector<size_t>& candidates, size_t vertex) const {
    std::vector<size_t> neighbours;
    for (const size_t c : candidates) {
      if (c != vertex && adjacent_[vertex][c]) neighbours.push_back(c);
    }
    return neighbours;
  }

  // From a vertex, again and again the one with most of the remaining candidates as neighbours.
  std::vector<size_t> GrowGreedily(size_t start) const {
    std::vector<size_t> clique = {start}, candidates;
    for (size_t i = 0; i < adjacent_.size(); ++i) {
      if (i != start && adjacent_[start][i]) candidates.push_back(i);
    }
    while (!candidates.empty()) {
      size_t best = candidates[0], most = 0;
      for (const size_t c : candidates) {
        const size_t degree = std::count_if(candidates.begin(), candidates.end(),
                                            [&](size_t d) { return d != c && adjacent_[c][d]; });
        if (degree > most) std::tie(best, most) = std::make_pair(c, degree);
      }
      clique.push_back(best);
      candidates = Neighbours(candidates, best);
    }
    return clique;
  }

  size_t WeightOf(const std::vector<size_t>& clique) const {
    size_t weight = 0;
    for (const size_t i : clique) weight += weights_[i];
    return weight;
  }

  void Consider(std::vector<size_t> clique) {
    std::sort(clique.begin(), clique.end());
    const size_t weight = WeightOf(clique);
    const bool better = clique.size() != best_.size() ? clique.size() > best_.size()
                        : weight != best_weight_      ? weight > best_weight_
                                                      : clique < best_;
    if (!better) return;
    best_ = std::move(clique);
    best_weight_ = weight;
  }

  // Colours needed by a greedy colouring: no clique among the candidates is larger.
  size_t ColourBound(const std::vector<size_t>& candidates) const {
    std::vector<std::vector<size_t>> classes;
    for (const size_t c : candidates) {
      const auto fits = [&](const std::vector<size_t>& members) {
        return std::none_of(members.begin(), members.end(),
                            [&](size_t m) { return adjacent_[c][m]; });
      };
      const auto it = std::find_if(classes.begin(), classes.end(), fits);
      if (it != classes.end()) {
        it->push_back(c);
      } else {
        classes.push_back({c});
      }
    }
    return classes.size();
  }

  // Equal sizes are followed, too, because the tie is broken by weight.
  void Expand(std::vector<size_t> candidates, std::vector<size_t>* clique) {
    if (candidates.empty()) {
      Consider(*clique);
      return;
    }
    while (!candidates.empty()) {
      if (branches_left_ <= 0) return;
      if (clique->size() + ColourBound(candidates) < best_.size()) return;
      --branches_left_;
      const size_t vertex = candidates.front();
      clique->push_back(vertex);
      Expand(Neighbours(candidates, vertex), clique);
      clique->pop_back();
      candidates.erase(candidates.begin());
    }
  }

  const std::vector<std::vector<bool>>& adjacent_;
  const std::vector<size_t> weights_;
  int branches_left_;
  std::vector<size_t> best_;
  size_t best_weight_ = 0;
};

}  // namespace

Status PairwiseConsistencyOptions::Validate() const {
  const bool valid = max_mahalanobis_squared > 0 && translation_floor >= 0 &&
                     rotation_floor_rad >= 0 && log_scale_floor >= 0 && max_branches >= 0;
  if (valid) return absl::OkStatus();
  return absl::InvalidArgumentError(
      "pairwise consistency: max_mahalanobis_squared must be positive, the floors and max_branches "
      "not negative");
}

std::optional<double> LoopMahalanobisSquared(const Closure& first, const Closure& second,
                                             const RelativeSimilarity& relative,
                                             const PairwiseConsistencyOptions& options) {
  const auto relation = RelationOf(first);
  const auto other = RelationOf(second);
  if (!relation || !other) return std::nullopt;
  const auto straight =
      OrientedLoop(*relation, *other, first.a, first.b, second.a, second.b, relative, options);
  if (straight) return straight;
  return OrientedLoop(*relation, Inverse(*other), first.a, first.b, second.b, second.a, relative,
                      options);
}

std::vector<size_t> LargestConsistentSet(const std::vector<Closure>& closures,
                                         const RelativeSimilarity& relative,
                                         const PairwiseConsistencyOptions& options) {
  const size_t count = closures.size();
  std::vector<std::vector<bool>> adjacent(count, std::vector<bool>(count, false));
  std::vector<size_t> weights;
  for (size_t i = 0; i < count; ++i) {
    weights.push_back(closures[i].matches.size());
    for (size_t j = 0; j < i; ++j) {
      const auto distance = LoopMahalanobisSquared(closures[j], closures[i], relative, options);
      const bool agree = distance && *distance < options.max_mahalanobis_squared;
      adjacent[i][j] = adjacent[j][i] = agree;
    }
  }
  return CliqueSearch(adjacent, std::move(weights), options.max_branches).Run();
}

}  // namespace portolan
