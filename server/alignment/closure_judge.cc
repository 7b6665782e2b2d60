#include "server/alignment/closure_judge.h"

#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <optional>
#include <utility>

#include "common/linear_algebra/dense.h"
#include "server/pose_graph/chordal_initialization.h"

namespace portolan {
namespace {

// Parts of a graph, named by their first node.
class Parts {
 public:
  explicit Parts(int count) : parent_(count) { std::iota(parent_.begin(), parent_.end(), 0); }

  int Find(int node) {
    while (parent_[node] != node) node = parent_[node] = parent_[parent_[node]];
    return node;
  }
  void Join(int a, int b) {
    const int first = std::min(Find(a), Find(b));
    parent_[Find(a)] = parent_[Find(b)] = first;
  }

 private:
  std::vector<int> parent_;
};

// The submaps of the links' chains, dead-reckoned from each chain's first node.
class Chains {
 public:
  Chains(int node_count, const std::vector<Relation>& relations)
      : chain_(node_count, -1), chain_from_node_(node_count), spread_(node_count) {
    std::vector<std::vector<const Relation*>> links(node_count);
    for (const Relation& relation : relations) {
      if (relation.doubtful) continue;
      links[relation.a].push_back(&relation);
      links[relation.b].push_back(&relation);
    }
    for (int first = 0; first < node_count; ++first) {
      if (chain_[first] >= 0) continue;
      chain_[first] = first;
      std::vector<int> front = {first};
      while (!front.empty()) {
        const int node = front.back();
        front.pop_back();
        for (const Relation* link : links[node]) Follow(*link, node, &front);
      }
    }
  }

  int chain(int node) const { return chain_[node]; }
  const Similarity3& chain_from_node(int node) const { return chain_from_node_[node]; }

  // Along the chain; what two nodes' ways from its first node share cancels.
  std::optional<UncertainSimilarity> Relative(int a, int b) const {
    if (chain_[a] != chain_[b]) return std::nullopt;
    const Matrix7d adjoint = chain_from_node_[b].Inverse().Adjoint();
    // Further from the start: more spread. One of the differences is positive semi-definite.
    const Matrix7d spread = spread_[b].trace() >= spread_[a].trace() ? spread_[b] - spread_[a]
                                                                     : spread_[a] - spread_[b];
    return UncertainSimilarity{chain_from_node_[a].Inverse() * chain_from_node_[b],
                               Congruence(adjoint, spread)};
  }

 private:
  void Follow(const Relation& link, int node, std::vector<int>* front) {
    const bool forward = link.a == node;
    const int next = forward ? link.b : link.a;
    if (chain_[next] >= 0) return;
    chain_[next] = chain_[node];
    chain_from_node_[next] =
        chain_from_node_[node] * (forward ? link.a_from_b : link.a_from_b.Inverse());
    // The link's covariance belongs to a right perturbation at b.
    const Matrix7d adjoint = chain_from_node_[link.b].Adjoint();
    spread_[next] =
        spread_[node] + Congruence(adjoint, InverseOfPositiveDefinite(link.information));
    front->push_back(next);
  }

  std::vector<int> chain_;  // its first node
  std::vector<Similarity3> chain_from_node_;
  std::vector<Matrix7d, Eigen::aligned_allocator<Matrix7d>> spread_;
};

class Judge {
 public:
  Judge(const ClosureJudgeOptions& options, int node_count, const std::vector<Relation>& relations,
        const std::vector<int>& support)
      : options_(options),
        node_count_(node_count),
        relations_(relations),
        support_(support),
        chains_(node_count, relations),
        used_(relations.size(), true) {}

  JudgedFleet Run() {
    if (options_.selection == ClosureSelection::kGraduated) {
      start_ = ChordalStart(node_count_, relations_);
    } else {
      SelectPairwise();
    }
    return Solve();
  }

 private:
  // A pair of chains and what agrees between them.
  struct Bridge {
    std::vector<size_t> closures;
    int support = 0;
  };

  void SelectPairwise() {
    std::map<std::pair<int, int>, std::vector<size_t>> groups;
    for (size_t i = 0; i < relations_.size(); ++i) {
      if (!relations_[i].doubtful) continue;
      groups[std::minmax(chains_.chain(relations_[i].a), chains_.chain(relations_[i].b))].push_back(
          i);
    }
    std::vector<bool> selected(relations_.size(), false);
    std::vector<Bridge> bridges;
    for (const auto& [chains, closures] : groups) {
      Bridge bridge = Agreeing(closures);
      for (const size_t i : bridge.closures) selected[i] = true;
      const bool joins =
          bridge.closures.size() > 1 || bridge.support >= options_.min_support_of_single;
      if (chains.first != chains.second && joins) bridges.push_back(std::move(bridge));
    }
    PlaceChains(std::move(bridges));
    for (size_t i = 0; i < relations_.size(); ++i) {
      if (!relations_[i].doubtful) continue;
      const bool in_part = part_[relations_[i].a] == part_[relations_[i].b];
      const bool all = options_.selection == ClosureSelection::kPairwiseStart;
      used_[i] = in_part && (all || selected[i]);
    }
  }

  Bridge Agreeing(const std::vector<size_t>& candidates) const {
    std::vector<Closure> closures;
    for (const size_t i : candidates) {
      Closure closure;
      closure.a = SubmapId(relations_[i].a);
      closure.b = SubmapId(relations_[i].b);
      closure.a_from_b = relations_[i].a_from_b;
      closure.information = relations_[i].information;
      closure.matches.resize(support_[i]);
      closures.push_back(std::move(closure));
    }
    const auto relative = [this](SubmapId a, SubmapId b) {
      return chains_.Relative(static_cast<int>(a.value()), static_cast<int>(b.value()));
    };
    Bridge bridge;
    for (const size_t i : LargestConsistentSet(closures, relative, options_.consistency)) {
      bridge.closures.push_back(candidates[i]);
      bridge.support += support_[candidates[i]];
    }
    return bridge;
  }

  // The chains with the strongest bridges first (a spanning tree), by the closure of each bridge
  // that has most support.
  void PlaceChains(std::vector<Bridge> bridges) {
    std::stable_sort(bridges.begin(), bridges.end(), [](const Bridge& x, const Bridge& y) {
      return x.closures.size() != y.closures.size() ? x.closures.size() > y.closures.size()
                                                    : x.support > y.support;
    });
    for (int node = 0; node < node_count_; ++node) {
      start_.push_back(chains_.chain_from_node(node));
      part_.push_back(chains_.chain(node));
    }
    for (const Bridge& bridge : bridges) {
      const size_t best =
          *std::max_element(bridge.closures.begin(), bridge.closures.end(),
                            [&](size_t x, size_t y) { return support_[x] < support_[y]; });
      const Relation& relation = relations_[best];
      int into = part_[relation.a], from = part_[relation.b];
      if (into == from) continue;
      Similarity3 into_from_from =
          start_[relation.a] * relation.a_from_b * start_[relation.b].Inverse();
      if (from < into) {
        std::swap(into, from);
        into_from_from = into_from_from.Inverse();
      }
      for (int node = 0; node < node_count_; ++node) {
        if (part_[node] != from) continue;
        part_[node] = into;
        start_[node] = into_from_from * start_[node];
      }
    }
  }

  JudgedFleet Solve() const {
    RelationGraph graph;
    graph.world_from_node = start_;
    Parts parts(node_count_);
    std::vector<size_t> of_graph;
    for (size_t i = 0; i < relations_.size(); ++i) {
      if (!used_[i]) continue;
      of_graph.push_back(i);
      graph.relations.push_back(relations_[i]);
      if (options_.selection == ClosureSelection::kPairwise)
        graph.relations.back().doubtful = false;
      parts.Join(relations_[i].a, relations_[i].b);
    }
    for (int node = 0; node < node_count_; ++node) graph.fixed.push_back(parts.Find(node) == node);
    const std::vector<double> weights = SolveRelationGraph(options_.graph, &graph);
    JudgedFleet fleet;
    fleet.world_from_node = graph.world_from_node;
    fleet.accepted.assign(relations_.size(), false);
    Parts connected(node_count_);
    for (size_t i = 0; i < of_graph.size(); ++i) {
      fleet.accepted[of_graph[i]] = weights[i] > 0.5;
      if (weights[i] > 0.5) connected.Join(relations_[of_graph[i]].a, relations_[of_graph[i]].b);
    }
    for (int node = 0; node < node_count_; ++node) {
      fleet.part_of_node.push_back(connected.Find(node));
    }
    return fleet;
  }

  const ClosureJudgeOptions& options_;
  const int node_count_;
  const std::vector<Relation>& relations_;
  const std::vector<int>& support_;
  const Chains chains_;
  std::vector<bool> used_;
  std::vector<Similarity3> start_;
  std::vector<int> part_;  // its first node
};

// Log scales with the given differences; those of `anchors` are zero.
std::vector<double> LogScales(int node_count, const std::vector<Relation>& relations,
                              const std::vector<int>& anchors) {
  std::vector<int> row(node_count, 0);
  for (const int anchor : anchors) row[anchor] = -1;
  int rows = 0;
  for (int& r : row) r = r < 0 ? -1 : rows++;
  std::vector<double> scales(node_count, 0.0);
  if (rows == 0) return scales;
  std::vector<Eigen::Triplet<double>> triplets;
  Eigen::VectorXd right = Eigen::VectorXd::Zero(rows);
  for (const Relation& relation : relations) {
    const double weight = relation.information(6, 6);
    const int a = row[relation.a], b = row[relation.b];
    const double difference = weight * std::log(relation.a_from_b.scale);
    if (a >= 0) triplets.emplace_back(a, a, weight), right[a] -= difference;
    if (b >= 0) triplets.emplace_back(b, b, weight), right[b] += difference;
    if (a >= 0 && b >= 0) triplets.emplace_back(std::max(a, b), std::min(a, b), -weight);
  }
  Eigen::SparseMatrix<double> normal(rows, rows);
  normal.setFromTriplets(triplets.begin(), triplets.end());
  const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>, Eigen::Lower> factor(normal);
  if (factor.info() != Eigen::Success) return scales;
  const Eigen::VectorXd solution = factor.solve(right);
  for (int node = 0; node < node_count; ++node) {
    if (row[node] >= 0) scales[node] = solution[row[node]];
  }
  return scales;
}

}  // namespace

Status ClosureJudgeOptions::Validate() const {
  PORTOLAN_RETURN_IF_ERROR(consistency.Validate());
  PORTOLAN_RETURN_IF_ERROR(graph.Validate());
  if (min_support_of_single < 1) {
    return absl::InvalidArgumentError("closure judge: min_support_of_single must be positive");
  }
  return absl::OkStatus();
}

JudgedFleet JudgeClosures(const ClosureJudgeOptions& options, int node_count,
                          const std::vector<Relation>& relations, const std::vector<int>& support) {
  return Judge(options, node_count, relations, support).Run();
}

std::vector<Similarity3> ChordalStart(int node_count, const std::vector<Relation>& relations) {
  Parts parts(node_count);
  for (const Relation& relation : relations) parts.Join(relation.a, relation.b);
  std::vector<int> anchors;
  for (int node = 0; node < node_count; ++node) {
    if (parts.Find(node) == node) anchors.push_back(node);
  }
  const std::vector<double> scales = LogScales(node_count, relations, anchors);
  PoseGraph3 graph;
  graph.world_from_node.resize(node_count);
  for (const Relation& relation : relations) {
    PoseEdge3 edge;
    edge.a = relation.a;
    edge.b = relation.b;
    const double scale = std::exp(scales[relation.a]);
    edge.a_from_b = {relation.a_from_b.rotation, scale * relation.a_from_b.translation};
    edge.information = relation.information.topLeftCorner<6, 6>();
    edge.information.topLeftCorner<3, 3>() /= scale * scale;
    graph.edges.push_back(edge);
  }
  std::vector<Similarity3> start(node_count);
  if (!InitializeChordal(anchors, graph).ok()) return start;
  for (int node = 0; node < node_count; ++node) {
    start[node] = Similarity3::FromRigid(graph.world_from_node[node], std::exp(scales[node]));
  }
  return start;
}

}  // namespace portolan
