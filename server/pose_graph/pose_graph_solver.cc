#include "server/pose_graph/pose_graph_solver.h"

#include <ceres/ceres.h>

#include <Eigen/Eigenvalues>
#include <chrono>
#include <numeric>
#include <string>

#include "server/pose_graph/chordal_initialization.h"
#include "server/pose_graph/pose_errors.h"

namespace portolan {
namespace {

// Square root W of the information, W'W = information; semi-definite is allowed.
template <int N>
Eigen::Matrix<double, N, N> SquareRoot(const Eigen::Matrix<double, N, N>& information) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, N, N>> eigen(information);
  return eigen.eigenvalues().cwiseMax(0).cwiseSqrt().asDiagonal() *
         eigen.eigenvectors().transpose();
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
  static void SetManifold(ceres::Problem& problem, double* pose) {
    problem.SetManifold(
        pose,
        new ceres::ProductManifold<ceres::EigenQuaternionManifold, ceres::EuclideanManifold<3>>());
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
  static void SetManifold(ceres::Problem&, double*) {}
};

template <typename Graph>
Status CheckGraph(const Graph& graph) {
  const int nodes = static_cast<int>(graph.world_from_node.size());
  for (const auto& edge : graph.edges) {
    if (edge.a < 0 || edge.a >= nodes || edge.b < 0 || edge.b >= nodes || edge.a == edge.b) {
      return absl::InvalidArgumentError("pose graph: an edge does not join two of the nodes");
    }
    using Information = std::decay_t<decltype(edge.information)>;
    const Eigen::SelfAdjointEigenSolver<Information> eigen(edge.information);
    if (!edge.information.allFinite() ||
        eigen.eigenvalues()[0] < -1e-9 * std::abs(eigen.eigenvalues().maxCoeff())) {
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

template <typename Traits>
int Minimize(const PoseGraphSolverOptions& options, const std::vector<int>& anchors,
             typename Traits::Graph& graph) {
  std::vector<std::array<double, Traits::kParameters>> poses;
  for (const auto& pose : graph.world_from_node) poses.push_back(Traits::Pack(pose));
  ceres::Problem problem;
  for (auto& pose : poses) {
    problem.AddParameterBlock(pose.data(), Traits::kParameters);
    Traits::SetManifold(problem, pose.data());
  }
  for (const auto& edge : graph.edges) {
    problem.AddResidualBlock(Traits::Cost(edge), nullptr, poses[static_cast<size_t>(edge.a)].data(),
                             poses[static_cast<size_t>(edge.b)].data());
  }
  for (int anchor : anchors) {
    problem.SetParameterBlockConstant(poses[static_cast<size_t>(anchor)].data());
  }
  ceres::Solver::Options solver;
  solver.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  solver.max_num_iterations = options.max_iterations;
  solver.num_threads = options.threads;
  // Steps converge by a factor of ten or more near the minimum: nine digits of chi2 are right.
  solver.function_tolerance = 1e-8;
  solver.gradient_tolerance = 1e-12;
  solver.parameter_tolerance = 1e-12;
  solver.initial_trust_region_radius = 1e8;
  solver.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(solver, &problem, &summary);
  for (size_t i = 0; i < poses.size(); ++i) graph.world_from_node[i] = Traits::Unpack(poses[i]);
  return static_cast<int>(summary.iterations.size());
}

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
  summary.iterations = Minimize<Traits>(options, anchors, graph);
  summary.final_chi2 = Chi2(graph);
  summary.seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start_time).count();
  return summary;
}

}  // namespace

Status PoseGraphSolverOptions::Validate() const {
  if (max_iterations < 1) return absl::InvalidArgumentError("max_iterations must be positive");
  if (threads < 1) return absl::InvalidArgumentError("threads must be positive");
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
