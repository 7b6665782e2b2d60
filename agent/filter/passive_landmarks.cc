// The compressed filter's part of FilterState: passive landmarks. README.md, "Compressed update".
#include <algorithm>
#include <utility>

#include "agent/filter/filter_state.h"
#include "common/base/check.h"
#include "common/linear_algebra/dense.h"

namespace portolan {

void FilterState::SwapBlocks(int a, int b) {
  if (a == b) return;
  const int n = dim(), at_a = BlockOffset(a), at_b = BlockOffset(b);
  covariance_.middleCols<3>(at_a).topRows(n).swap(covariance_.middleCols<3>(at_b).topRows(n));
  covariance_.middleRows<3>(at_a).leftCols(n).swap(covariance_.middleRows<3>(at_b).leftCols(n));
  std::swap(owners_[a], owners_[b]);
  for (int block : {a, b}) {
    const Owner& owner = owners_[block];
    (owner.is_anchor ? anchors_[owner.index].block : landmarks_[owner.index].block) = block;
  }
}

void FilterState::SetPassive(const std::vector<bool>& passive) {
  PORTOLAN_CHECK(passive.size() == landmarks_.size());
  Expand();
  const auto is_passive = [&](int block) {
    const Owner& owner = owners_[block];
    return !owner.is_anchor && passive[owner.index] && landmarks_[owner.index].euclidean;
  };
  int end = static_cast<int>(owners_.size());
  for (int block = 0; block < end;) {
    if (is_passive(block)) {
      SwapBlocks(block, --end);
    } else {
      ++block;
    }
  }
  passive_blocks_ = static_cast<int>(owners_.size()) - end;
  if (passive_blocks_ == 0) return;
  if (factor_.rows() < covariance_.rows()) {
    factor_.resize(covariance_.rows(), covariance_.cols());
    reduction_.resize(covariance_.rows(), covariance_.cols());
  }
  const int n = active_dim();
  factor_.topLeftCorner(n, n).setIdentity();
  reduction_.topLeftCorner(n, n).setZero();
}

void FilterState::UpdatePassive(const Eigen::Ref<const Eigen::MatrixXd>& half_gain,
                                const Eigen::Ref<const Eigen::MatrixXd>& whitened_rows,
                                const Eigen::Ref<const Eigen::VectorXd>& whitened_innovation) {
  // With U = L^-1 H F and W = L^-1 H P_aa:  x_p += P_ap0' U' w,  F <- F - W' U,  G <- G + U' U.
  const int n = active_dim(), passive = dim() - n;
  const Eigen::VectorXd moved = TransposedProduct(whitened_rows, whitened_innovation);
  const Eigen::VectorXd error = TransposedProduct(covariance_.block(0, n, n, passive), moved);
  for (Landmark& landmark : landmarks_) {
    if (IsPassive(landmark)) landmark.Correct(error.segment<3>(Offset(landmark) - n));
  }
  AddTransposedProduct(-1, half_gain, whitened_rows, factor_.topLeftCorner(n, n));
  AddGram(1, whitened_rows, reduction_.topLeftCorner(n, n));
}

void FilterState::Activate(int index) {
  if (!IsPassive(landmarks_[index])) return;
  SwapBlocks(landmarks_[index].block, active_blocks());
  const int n = active_dim(), rest = dim() - n - 3;
  const Eigen::MatrixXd stored = covariance_.block(0, n, n, 3);
  const Eigen::MatrixXd reduced = Product(reduction_.topLeftCorner(n, n), stored);
  AddTransposedProduct(-1, stored, reduced, covariance_.block(n, n, 3, 3));
  Symmetrise(covariance_.block(n, n, 3, 3));
  // Its rows against those that stay passive are as of now: they get the factor one.
  AddTransposedProduct(-1, reduced, covariance_.block(0, n + 3, n, rest),
                       covariance_.block(n, n + 3, 3, rest));
  covariance_.block(n + 3, n, rest, 3) = covariance_.block(n, n + 3, 3, rest).transpose();
  SetToProduct(passive_factor(), stored, covariance_.block(0, n, n, 3));
  covariance_.block(n, 0, 3, n) = covariance_.block(0, n, n, 3).transpose();
  for (Eigen::MatrixXd* matrix : {&factor_, &reduction_}) {
    matrix->block(0, n, n + 3, 3).setZero();
    matrix->block(n, 0, 3, n).setZero();
  }
  factor_.block<3, 3>(n, n).setIdentity();
  --passive_blocks_;
}

void FilterState::ExpandInto(Eigen::MatrixXd* covariance) const {
  const int n = active_dim(), passive = dim() - n;
  auto cross = covariance->block(0, n, n, passive);
  auto own = covariance->block(n, n, passive, passive);
  AddTransposedProduct(-1, cross, Product(reduction_.topLeftCorner(n, n), cross), own);
  Symmetrise(own);
  cross = Product(passive_factor(), cross);
  covariance->block(n, 0, passive, n) = cross.transpose();
}

void FilterState::Expand() {
  if (passive_blocks_ == 0) return;
  ExpandInto(&covariance_);
  passive_blocks_ = 0;
}

Eigen::MatrixXd FilterState::ExpandedCovariance() const {
  Eigen::MatrixXd result = covariance();
  if (passive_blocks_ > 0) ExpandInto(&result);
  return result;
}

}  // namespace portolan
