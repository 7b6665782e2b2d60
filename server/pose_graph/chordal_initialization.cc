#include "server/pose_graph/chordal_initialization.h"

#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <cmath>

#include "common/linear_algebra/dense.h"

namespace portolan {
namespace {

// One relation X_b - M * X_a = D between the D x C blocks of two nodes.
struct LinearEdge {
  int a, b;
  Eigen::MatrixXd m;
  Eigen::MatrixXd d;
  double weight;
};

// Least squares over all edges; the blocks of the anchors keep their values.
Status SolveLinear(const std::vector<LinearEdge>& edges, const std::vector<int>& anchors,
                   int block_rows, std::vector<Eigen::MatrixXd>& blocks) {
  std::vector<int> column(blocks.size(), 0);
  for (int anchor : anchors) column[static_cast<size_t>(anchor)] = -1;
  int unknowns = 0;
  for (int& c : column) {
    if (c == 0) c = block_rows * unknowns++;
  }
  if (unknowns == 0) return absl::OkStatus();
  const auto block_columns = blocks.front().cols();
  Eigen::MatrixXd rhs = Eigen::MatrixXd::Zero(block_rows * unknowns, block_columns);
  std::vector<Eigen::Triplet<double>> triplets;
  const auto add = [&triplets](int row, int col, const Eigen::MatrixXd& block) {
    for (int i = 0; i < block.rows(); ++i) {
      for (int j = 0; j < block.cols(); ++j) {
        if (row + i >= col + j) triplets.emplace_back(row + i, col + j, block(i, j));
      }
    }
  };
  for (const LinearEdge& edge : edges) {
    const int a = column[static_cast<size_t>(edge.a)], b = column[static_cast<size_t>(edge.b)];
    const Eigen::MatrixXd& m = edge.m;
    const double w = edge.weight;
    if (a >= 0) {
      add(a, a, w * TransposedProduct(m, m));
      AddTransposedProduct(-w, m, edge.d, rhs.middleRows(a, block_rows));
    }
    if (b >= 0) {
      add(b, b, w * Eigen::MatrixXd::Identity(block_rows, block_rows));
      rhs.middleRows(b, block_rows) += w * edge.d;
    }
    if (a >= 0 && b >= 0) {
      if (b > a) {
        add(b, a, -w * m);
      } else {
        add(a, b, -w * m.transpose());
      }
    } else if (a >= 0) {
      AddTransposedProduct(w, m, blocks[static_cast<size_t>(edge.b)],
                           rhs.middleRows(a, block_rows));
    } else if (b >= 0) {
      AddProduct(w, m, blocks[static_cast<size_t>(edge.a)], rhs.middleRows(b, block_rows));
    }
  }
  Eigen::SparseMatrix<double> normal(rhs.rows(), rhs.rows());
  normal.setFromTriplets(triplets.begin(), triplets.end());
  Eigen::SimplicialLLT<Eigen::SparseMatrix<double>, Eigen::Lower> cholesky(normal);
  if (cholesky.info() != Eigen::Success) {
    return absl::FailedPreconditionError("pose graph: a part of the graph hangs on no anchor");
  }
  const Eigen::MatrixXd solution = cholesky.solve(rhs);
  for (size_t i = 0; i < blocks.size(); ++i) {
    if (column[i] >= 0) blocks[i] = solution.middleRows(column[i], block_rows);
  }
  return absl::OkStatus();
}

Eigen::MatrixXd ProjectToRotation(const Eigen::MatrixXd& m) {
  if (m.rows() == 2) return NearestRotation(Eigen::Matrix2d(m));
  return NearestRotation(Eigen::Matrix3d(m));
}

// A dimension-independent edge and pose.
struct MatrixEdge {
  int a, b;
  Eigen::MatrixXd rotation;
  Eigen::VectorXd translation;
  double rotation_weight, translation_weight;
};

Status Initialize(const std::vector<MatrixEdge>& edges, const std::vector<int>& anchors,
                  std::vector<Eigen::MatrixXd>& rotations,
                  std::vector<Eigen::MatrixXd>& translations) {
  const int dimension = static_cast<int>(rotations.front().rows());
  // R_b = R_a R_ab, transposed: X_b - R_ab' X_a = 0 with X = R'.
  std::vector<LinearEdge> linear;
  for (const MatrixEdge& edge : edges) {
    linear.push_back({edge.a, edge.b, edge.rotation.transpose(),
                      Eigen::MatrixXd::Zero(dimension, dimension), edge.rotation_weight});
  }
  for (auto& rotation : rotations) rotation.transposeInPlace();
  PORTOLAN_RETURN_IF_ERROR(SolveLinear(linear, anchors, dimension, rotations));
  for (auto& rotation : rotations) rotation = ProjectToRotation(rotation.transpose()).eval();
  // t_b - t_a = R_a t_ab; one unknown row of `dimension` columns a node.
  linear.clear();
  for (const MatrixEdge& edge : edges) {
    const Eigen::MatrixXd step = Product(rotations[static_cast<size_t>(edge.a)], edge.translation);
    linear.push_back(
        {edge.a, edge.b, Eigen::MatrixXd::Ones(1, 1), step.transpose(), edge.translation_weight});
  }
  for (auto& translation : translations) translation.transposeInPlace();
  PORTOLAN_RETURN_IF_ERROR(SolveLinear(linear, anchors, 1, translations));
  for (auto& translation : translations) translation.transposeInPlace();
  return absl::OkStatus();
}

}  // namespace

Status InitializeChordal(const std::vector<int>& anchors, PoseGraph3& graph) {
  if (graph.world_from_node.empty()) return absl::OkStatus();
  std::vector<Eigen::MatrixXd> rotations, translations;
  for (const Rigid3& pose : graph.world_from_node) {
    rotations.emplace_back(pose.rotation.toRotationMatrix());
    translations.emplace_back(pose.translation);
  }
  std::vector<MatrixEdge> edges;
  for (const PoseEdge3& edge : graph.edges) {
    edges.push_back({edge.a, edge.b, edge.a_from_b.rotation.toRotationMatrix(),
                     edge.a_from_b.translation, edge.information.diagonal().tail<3>().mean(),
                     edge.information.diagonal().head<3>().mean()});
  }
  PORTOLAN_RETURN_IF_ERROR(Initialize(edges, anchors, rotations, translations));
  for (size_t i = 0; i < rotations.size(); ++i) {
    graph.world_from_node[i] = {Eigen::Quaterniond(Eigen::Matrix3d(rotations[i])).normalized(),
                                translations[i]};
  }
  return absl::OkStatus();
}

Status InitializeChordal(const std::vector<int>& anchors, PoseGraph2& graph) {
  if (graph.world_from_node.empty()) return absl::OkStatus();
  const auto rotation_of = [](double heading) {
    return Eigen::MatrixXd(Eigen::Rotation2Dd(heading).toRotationMatrix());
  };
  std::vector<Eigen::MatrixXd> rotations, translations;
  for (const Eigen::Vector3d& pose : graph.world_from_node) {
    rotations.push_back(rotation_of(pose[2]));
    translations.emplace_back(pose.head<2>());
  }
  std::vector<MatrixEdge> edges;
  for (const PoseEdge2& edge : graph.edges) {
    edges.push_back({edge.a, edge.b, rotation_of(edge.a_from_b[2]), edge.a_from_b.head<2>(),
                     edge.information(2, 2), edge.information.diagonal().head<2>().mean()});
  }
  PORTOLAN_RETURN_IF_ERROR(Initialize(edges, anchors, rotations, translations));
  for (size_t i = 0; i < rotations.size(); ++i) {
    graph.world_from_node[i] << translations[i], std::atan2(rotations[i](1, 0), rotations[i](0, 0));
  }
  return absl::OkStatus();
}

}  // namespace portolan
