#include "common/bundle/camera_system.h"

#include <algorithm>
#include <utility>

#include "common/linear_algebra/dense.h"
#include "common/linear_algebra/sparse_cholesky.h"

namespace portolan {

struct CameraSystem::Factor {
  SparseCholesky cholesky;
  Eigen::SparseMatrix<double> matrix;
  // Of every column of blocks, from the diagonal down: row of the block and its place.
  std::vector<std::vector<std::pair<int, int32_t>>> columns;
  bool is_analyzed = false;
};

CameraSystem::CameraSystem(int cameras, int max_dense)
    : cameras_(cameras), is_sparse_(cameras > max_dense) {
  if (!is_sparse_) {
    dense_.resize(6 * cameras, 6 * cameras);
    return;
  }
  places_.assign(static_cast<size_t>(cameras) * cameras, -1);
  factor_ = std::make_unique<Factor>();
}

CameraSystem::~CameraSystem() = default;

int32_t CameraSystem::NewBlock() {
  factor_->is_analyzed = false;
  blocks_.resize(blocks_.size() + 36, 0.0);
  return static_cast<int32_t>(blocks_.size() / 36 - 1);
}

void CameraSystem::SetZero() {
  dense_.setZero();
  std::fill(blocks_.begin(), blocks_.end(), 0.0);
}

void CameraSystem::FillFactorInput() {
  auto& matrix = factor_->matrix;
  if (!factor_->is_analyzed) {
    factor_->columns.assign(cameras_, {});
    Eigen::VectorXi sizes(6 * cameras_);
    for (int column = 0; column < cameras_; ++column) {
      for (int row = column; row < cameras_; ++row) {
        const int32_t place = places_[static_cast<size_t>(row) * cameras_ + column];
        if (place >= 0) factor_->columns[column].emplace_back(row, place);
      }
      sizes.segment<6>(6 * column)
          .setConstant(6 * static_cast<int>(factor_->columns[column].size()));
    }
    matrix.resize(6 * cameras_, 6 * cameras_);
    matrix.resizeNonZeros(sizes.sum());
    int* inner = matrix.innerIndexPtr();
    int* outer = matrix.outerIndexPtr();
    outer[0] = 0;
    for (int i = 0; i < 6 * cameras_; ++i) {
      outer[i + 1] = outer[i] + sizes[i];
      for (const auto& [row, place] : factor_->columns[i / 6]) {
        for (int r = 0; r < 6; ++r) *inner++ = 6 * row + r;
      }
    }
  }
  double* value = matrix.valuePtr();
  for (const auto& column : factor_->columns) {
    for (int c = 0; c < 6; ++c) {
      for (const auto& [row, place] : column) {
        value = std::copy_n(blocks_.data() + 36 * static_cast<size_t>(place) + 6 * c, 6, value);
      }
    }
  }
}

bool CameraSystem::SolveInPlace(Eigen::VectorXd* right) {
  if (cameras_ == 0) return true;
  if (!is_sparse_) {
    if (!FactorCholesky(dense_)) return false;
    SolveFactored(dense_, *right);
    return right->allFinite();
  }
  FillFactorInput();
  if (!factor_->is_analyzed) factor_->cholesky.Analyze(factor_->matrix);
  factor_->is_analyzed = true;
  if (!factor_->cholesky.Factorize(factor_->matrix)) return false;
  *right = factor_->cholesky.Solve(*right);
  return right->allFinite();
}

}  // namespace portolan
