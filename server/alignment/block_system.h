// Normal equations in blocks of seven (a similarity's tangent), filled block by block.
#ifndef PORTOLAN_SERVER_ALIGNMENT_BLOCK_SYSTEM_H_
#define PORTOLAN_SERVER_ALIGNMENT_BLOCK_SYSTEM_H_

#include <cstdint>
#include <unordered_map>

#include "common/geometry/similarity3.h"
#include "common/linear_algebra/sparse_cholesky.h"

namespace portolan {

// information step = -gradient. Thread-compatible.
class BlockSystem {
 public:
  // All zero. With as many blocks as before, those that were used stay in the pattern, which is
  // then analysed only once.
  void Reset(int blocks);
  // Of the lower triangle: row >= column. In a block on the diagonal all of it counts.
  Matrix7d& Block(int row, int column);
  Eigen::VectorXd& gradient() { return gradient_; }
  // With the diagonal multiplied by 1 + damping. False if the matrix is not positive definite.
  bool Solve(double damping, Eigen::VectorXd* step);

 private:
  std::unordered_map<uint64_t, Matrix7d> information_;
  Eigen::VectorXd gradient_;
  SparseCholesky cholesky_;
  bool is_analyzed_ = false;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_ALIGNMENT_BLOCK_SYSTEM_H_
