// Normal equations of a bundle adjustment's cameras in blocks of six: dense for few cameras, sparse
// for many.
#ifndef PORTOLAN_COMMON_BUNDLE_CAMERA_SYSTEM_H_
#define PORTOLAN_COMMON_BUNDLE_CAMERA_SYSTEM_H_

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <vector>

namespace portolan {

using CameraBlock = Eigen::Map<Eigen::Matrix<double, 6, 6>, 0, Eigen::OuterStride<>>;

// Lower triangle of a symmetric matrix. Thread-compatible.
class CameraSystem {
 public:
  // Dense up to max_dense cameras. A sparse one keeps a number of 4 bytes for every pair.
  CameraSystem(int cameras, int max_dense);
  ~CameraSystem();
  CameraSystem(const CameraSystem&) = delete;
  CameraSystem& operator=(const CameraSystem&) = delete;

  // All zero. Blocks of a sparse system that were used stay in its pattern.
  void SetZero();
  // row >= column, in cameras; of a block on the diagonal the lower triangle counts. Valid until
  // the next call.
  CameraBlock Block(int row, int column) {
    if (!is_sparse_) {
      return CameraBlock(dense_.data() + 6 * (row + column * dense_.rows()),
                         Eigen::OuterStride<>(6 * cameras_));
    }
    int32_t& place = places_[static_cast<size_t>(row) * cameras_ + column];
    if (place < 0) place = NewBlock();
    return CameraBlock(blocks_.data() + 36 * static_cast<size_t>(place), Eigen::OuterStride<>(6));
  }
  bool is_sparse() const { return is_sparse_; }
  // Of a dense one: all blocks of `count` cameras from the first, whose lower triangle counts.
  Eigen::Block<Eigen::MatrixXd> Square(int first, int count) {
    return dense_.block(6 * first, 6 * first, 6 * count, 6 * count);
  }
  // Replaces the right side by the solution; the matrix is spoilt. False if it is not positive
  // definite or the solution is not finite.
  bool SolveInPlace(Eigen::VectorXd* right);

 private:
  struct Factor;

  int32_t NewBlock();
  void FillFactorInput();

  const int cameras_;
  const bool is_sparse_;
  Eigen::MatrixXd dense_;
  std::vector<int32_t> places_;  // of a pair's block; -1 if there is none
  std::vector<double> blocks_;   // 36 numbers each, by columns
  std::unique_ptr<Factor> factor_;
};

}  // namespace portolan

#endif  // PORTOLAN_COMMON_BUNDLE_CAMERA_SYSTEM_H_
