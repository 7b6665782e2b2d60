#include "server/pose_graph/pose_graph_solver.h"

#include <ceres/ceres.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <memory>
#include <numeric>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/linear_algebra/dense.h"
#include "server/pose_graph/chordal_initialization.h"
#include "server/pose_graph/normal_equations.h"
#include "server/pose_graph/pose_errors.h"

namespace portolan {
namespace {

// Square root W of the information, W'W = information; semi-definite is allowed.
template <int N>
Eigen::Matrix<double, N, N> SquareRoot(const Eigen::Matrix<double, N, N>& information) {
  const SymmetricEigen eigen = DecomposeSymmetric(information);
  return eigen.values.cwiseMax(0).cwiseSqrt().asDiagonal() * eigen.vectors.transpose();
}

struct Cost3 {
  PoseEdge3 edge;
  Matrix6d square_root;

  template <typename T>
  bool operator()(const T* a, const T* b, T* residuals) const {
    Eigen::Map<Eigen::Matrix<T, 6, 1>> mapped(residuals);
    mapped = square_root.template cast<T>() * PoseError3(edge, a, b);
    return true;
  }
};

struct Cost2 {
  PoseEdge2 edge;
  Eigen::Matrix3d square_root;

  template <typename T>
  bool operator()(const T* a, const T* b, T* residuals) const {
    Eigen::Map<Eigen::Matrix<T, 3, 1>> mapped(residuals);
    mapped = square_root.template cast<T>() * PoseError2(edge, a, b);
    return true;
  }
};

// What differs between the two dimensions.
struct Traits3 {
  using Graph = PoseGraph3;
  static constexpr int kParameters = 7;
  static std::array<double, 7> Pack(const Rigid3& pose) {
    std::array<double, 7> packed;
    Eigen::Map<Vector7d>(packed.data()) << pose.rotation.coeffs(), pose.translation;
    return packed;
  }
  static Rigid3 Unpack(const std::array<double, 7>& packed) {
    return {Eigen::Quaterniond(packed.data()).normalized(),
            Eigen::Map<const Eigen::Vector3d>(packed.data() + 4)};
  }
  static ceres::CostFunction* Cost(const PoseEdge3& edge) {
    return new ceres::AutoDiffCostFunction<Cost3, 6, 7, 7>(
        new Cost3{edge, SquareRoot<6>(edge.information)});
  }
  static constexpr int kTangent = 6;
  static std::unique_ptr<ceres::Manifold> MakeManifold() {
    return std::make_unique<
        ceres::ProductManifold<ceres::EigenQuaternionManifold, ceres::EuclideanManifold<3>>>();
  }
};

struct Traits2 {
  using Graph = PoseGraph2;
  static constexpr int kParameters = 3;
  static std::array<double, 3> Pack(const Eigen::Vector3d& pose) {
    return {pose[0], pose[1], pose[2]};
  }
  static Eigen::Vector3d Unpack(const std::array<double, 3>& packed) {
    return {packed[0], packed[1], std::remainder(packed[2], 2 * M_PI)};
  }
  static ceres::CostFunction* Cost(const PoseEdge2& edge) {
    return new ceres::AutoDiffCostFunction<Cost2, 3, 3, 3>(
        new Cost2{edge, SquareRoot<3>(edge.information)});
  }
  static constexpr int kTangent = 3;
  static std::unique_ptr<ceres::Manifold> MakeManifold() {
    return std::make_unique<ceres::EuclideanManifold<3>>();
  }
};

template <typename Graph>
Status CheckGraph(const Graph& graph) {
  const int nodes = static_cast<int>(graph.world_from_node.size());
  for (const auto& edge : graph.edges) {
    if (edge.a < 0 || edge.a >= nodes || edge.b < 0 || edge.b >= nodes || edge.a == edge.b) {
      return absl::InvalidArgumentError("pose graph: an edge does not join two of the nodes");
    }
    const Eigen::VectorXd eigenvalues = DecomposeSymmetric(edge.information).values;
    if (!edge.information.allFinite() ||
        eigenvalues[0] < -1e-9 * std::abs(eigenvalues.maxCoeff())) {
      return absl::InvalidArgumentError("pose graph: the information matrix of the edge from " +
                                        std::to_string(graph.ids[static_cast<size_t>(edge.a)]) +
                                        " to " +
                                        std::to_string(graph.ids[static_cast<size_t>(edge.b)]) +
                                        " is not positive semi-definite");
    }
  }
  return absl::OkStatus();
}

// The fixed nodes, and the first node of every connected part that has none.
template <typename Graph>
std::vector<int> Anchors(const Graph& graph, int& connected_parts) {
  std::vector<int> parent(graph.world_from_node.size());
  std::iota(parent.begin(), parent.end(), 0);
  const auto root = [&parent](int node) {
    while (parent[static_cast<size_t>(node)] != node) {
      auto& up = parent[static_cast<size_t>(node)];
      up = parent[static_cast<size_t>(up)];
      node = up;
    }
    return node;
  };
  for (const auto& edge : graph.edges) {
    const int a = root(edge.a), b = root(edge.b);
    parent[static_cast<size_t>(std::max(a, b))] = std::min(a, b);
  }
  std::vector<int> anchors = graph.fixed;
  std::vector<bool> held(parent.size());
  for (int node : graph.fixed) held[static_cast<size_t>(root(node))] = true;
  connected_parts = 0;
  for (int node = 0; node < static_cast<int>(parent.size()); ++node) {
    if (root(node) != node) continue;
    ++connected_parts;
    if (!held[static_cast<size_t>(node)]) anchors.push_back(node);
  }
  return anchors;
}

// Levenberg-Marquardt; `Traits` says what differs between the dimensions.
template <typename Traits>
class Minimizer {
 public:
  using Graph = typename Traits::Graph;

  Minimizer(const PoseGraphSolverOptions& options, const std::vector<int>& anchors, Graph* graph)
      : options_(options), graph_(*graph), manifold_(Traits::MakeManifold()) {
    std::vector<bool> held(graph_.world_from_node.size(), false);
    for (const int anchor : anchors) held[static_cast<size_t>(anchor)] = true;
    for (size_t node = 0; node < held.size(); ++node) {
      block_.push_back(held[node] ? -1 : blocks_++);
      poses_.push_back(Traits::Pack(graph_.world_from_node[node]));
    }
    for (const auto& edge : graph_.edges) {
      costs_.emplace_back(Traits::Cost(edge));
      pairs_.emplace_back(block_[static_cast<size_t>(edge.a)], block_[static_cast<size_t>(edge.b)]);
    }
  }

  // Returns the number of iterations.
  int Run() {
    if (blocks_ == 0 || pairs_.empty()) return 0;
    NormalEquations equations(blocks_, Traits::kTangent, pairs_);
    double cost = Cost(poses_);
    // Nielsen's rule for the damping ("Damping parameter in Marquardt's method", 1999).
    double damping = kFirstDamping, growth = 2;
    int iteration = 0;
    for (bool converged = false; !converged && iteration < options_.max_iterations; ++iteration) {
      Linearize(&equations);
      converged = true;
      for (int attempt = 0; attempt < kMaxAttempts; ++attempt) {
        double predicted = 0;
        const std::optional<std::vector<Pose>> next = Step(damping, &equations, &predicted);
        const double decrease = next ? cost - Cost(*next) : -1;
        if (decrease >= 0) {
          const double gain = predicted > 0 ? decrease / predicted : 1;
          damping *= std::max(1.0 / 3, 1 - std::pow(2 * std::min(gain, 1.0) - 1, 3));
          growth = 2;
          converged = decrease <= kRelativeDecrease * cost;
          cost -= decrease;
          poses_ = *next;
          break;
        }
        damping *= growth;
        growth *= 2;
      }
    }
    for (size_t i = 0; i < poses_.size(); ++i) {
      graph_.world_from_node[i] = Traits::Unpack(poses_[i]);
    }
    return iteration;
  }

 private:
  using Pose = std::array<double, Traits::kParameters>;
  static constexpr int kTangent = Traits::kTangent;
  static constexpr int kMaxAttempts = 12;
  static constexpr double kFirstDamping = 1e-8;  // nearly none
  // Steps converge by a factor of ten or more near the minimum: nine digits of chi2 are right.
  static constexpr double kRelativeDecrease = 1e-8;

  double Cost(const std::vector<Pose>& poses) const {
    double sum = 0;
    Eigen::Matrix<double, kTangent, 1> residuals;
    for (size_t i = 0; i < costs_.size(); ++i) {
      const double* parameters[] = {poses[static_cast<size_t>(graph_.edges[i].a)].data(),
                                    poses[static_cast<size_t>(graph_.edges[i].b)].data()};
      costs_[i]->Evaluate(parameters, residuals.data(), nullptr);
      sum += residuals.squaredNorm();
    }
    return sum;
  }

  void Linearize(NormalEquations* equations) const {
    using Ambient = Eigen::Matrix<double, kTangent, Traits::kParameters, Eigen::RowMajor>;
    using Plus = Eigen::Matrix<double, Traits::kParameters, kTangent, Eigen::RowMajor>;
    std::vector<Plus> plus(poses_.size());
    for (size_t i = 0; i < poses_.size(); ++i) {
      manifold_->PlusJacobian(poses_[i].data(), plus[i].data());
    }
    equations->SetZero();
    Eigen::Matrix<double, kTangent, 1> residuals;
    Ambient d_a, d_b;
    double* jacobians[] = {d_a.data(), d_b.data()};
    for (size_t i = 0; i < costs_.size(); ++i) {
      const auto a = static_cast<size_t>(graph_.edges[i].a);
      const auto b = static_cast<size_t>(graph_.edges[i].b);
      const double* parameters[] = {poses_[a].data(), poses_[b].data()};
      costs_[i]->Evaluate(parameters, residuals.data(), jacobians);
      const Eigen::Matrix<double, kTangent, kTangent> local_a = d_a * plus[a];
      const Eigen::Matrix<double, kTangent, kTangent> local_b = d_b * plus[b];
      equations->Add(i, residuals, local_a, local_b);
    }
  }

  std::optional<std::vector<Pose>> Step(double damping, NormalEquations* equations,
                                        double* predicted) const {
    Eigen::VectorXd step;
    const std::optional<double> decrease = equations->Solve(damping, &step);
    if (!decrease) return std::nullopt;
    *predicted = *decrease;
    std::vector<Pose> next = poses_;
    for (size_t i = 0; i < poses_.size(); ++i) {
      if (block_[i] < 0) continue;
      manifold_->Plus(poses_[i].data(), step.data() + block_[i] * kTangent, next[i].data());
    }
    return next;
  }

  const PoseGraphSolverOptions& options_;
  Graph& graph_;
  const std::unique_ptr<ceres::Manifold> manifold_;
  std::vector<Pose> poses_;
  std::vector<int> block_;  // of a node; -1 if it is held
  int blocks_ = 0;
  std::vector<std::unique_ptr<ceres::CostFunction>> costs_;  // parallel to the edges
  std::vector<std::pair<int, int>> pairs_;
};

template <typename Traits>
StatusOr<PoseGraphSummary> Solve(const PoseGraphSolverOptions& options,
                                 typename Traits::Graph& graph) {
  const auto start_time = std::chrono::steady_clock::now();
  PORTOLAN_RETURN_IF_ERROR(options.Validate());
  PORTOLAN_RETURN_IF_ERROR(CheckGraph(graph));
  PoseGraphSummary summary;
  summary.initial_chi2 = summary.start_chi2 = Chi2(graph);
  const std::vector<int> anchors = Anchors(graph, summary.connected_parts);
  typename Traits::Graph chordal = graph;
  if (options.chordal_start && InitializeChordal(anchors, chordal).ok()) {
    // Whichever start is lower leads; the other is tried only if it is not far worse.
    const double chordal_chi2 = Chi2(chordal);
    if (chordal_chi2 < summary.initial_chi2) {
      summary.chordal_start_won = true;
      summary.start_chi2 = chordal_chi2;
      graph = std::move(chordal);
    }
  }
  summary.iterations = Minimizer<Traits>(options, anchors, &graph).Run();
  summary.final_chi2 = Chi2(graph);
  summary.seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start_time).count();
  return summary;
}

}  // namespace

Status PoseGraphSolverOptions::Validate() const {
  if (max_iterations < 1) return absl::InvalidArgumentError("max_iterations must be positive");
  return absl::OkStatus();
}

StatusOr<PoseGraphSummary> SolvePoseGraph(const PoseGraphSolverOptions& options,
                                          PoseGraph3& graph) {
  return Solve<Traits3>(options, graph);
}

StatusOr<PoseGraphSummary> SolvePoseGraph(const PoseGraphSolverOptions& options,
                                          PoseGraph2& graph) {
  return Solve<Traits2>(options, graph);
}

}  // namespace portolan
