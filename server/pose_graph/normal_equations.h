// Gauss-Newton's normal equations of a graph whose nodes have a few unknowns each: assembled in
// place and factorised with one symbolic analysis for all iterations.
#ifndef PORTOLAN_SERVER_POSE_GRAPH_NORMAL_EQUATIONS_H_
#define PORTOLAN_SERVER_POSE_GRAPH_NORMAL_EQUATIONS_H_

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <span>
#include <utility>

namespace portolan {

// (sum J' J) step = -(sum J' r). Thread-compatible.
class NormalEquations {
 public:
  // `pairs` are the edges' nodes, as indices of `blocks` unknown blocks of `block_size`; -1 for a
  // node that is held.
  NormalEquations(int blocks, int block_size, std::span<const std::pair<int, int>> pairs);
  ~NormalEquations();

  void SetZero();
  // Adds an edge: its residuals and their derivatives by each of its two nodes.
  void Add(size_t edge, const Eigen::Ref<const Eigen::VectorXd>& residuals,
           const Eigen::Ref<const Eigen::MatrixXd>& d_a,
           const Eigen::Ref<const Eigen::MatrixXd>& d_b);
  // With the diagonal of the matrix multiplied by 1 + damping. Returns by how much the linear model
  // lets the sum of squares decrease; no value if the matrix is not positive definite.
  std::optional<double> Solve(double damping, Eigen::VectorXd* step);

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_POSE_GRAPH_NORMAL_EQUATIONS_H_
