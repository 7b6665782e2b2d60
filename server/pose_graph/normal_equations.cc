#include "server/pose_graph/normal_equations.h"

#include <Eigen/SparseCore>
#include <algorithm>
#include <vector>

#include "common/linear_algebra/dense.h"
#include "common/linear_algebra/sparse_cholesky.h"

namespace portolan {

class NormalEquations::Impl {
 public:
  Impl(int blocks, int block_size, std::span<const std::pair<int, int>> pairs)
      : size_(block_size), pairs_(pairs.begin(), pairs.end()) {
    MakePattern(blocks);
    for (const auto& [a, b] : pairs_) {
      places_.push_back({a < 0 ? 0 : PlaceOf(a, a), b < 0 ? 0 : PlaceOf(b, b),
                         a < 0 || b < 0 ? 0 : PlaceOf(std::max(a, b), std::min(a, b))});
    }
    for (int i = 0; i < blocks * size_; ++i) diagonal_.push_back(matrix_.outerIndexPtr()[i]);
    gradient_.setZero(blocks * size_);
    solver_.Analyze(matrix_);
  }

  void SetZero() {
    std::fill_n(matrix_.valuePtr(), matrix_.nonZeros(), 0.0);
    gradient_.setZero();
  }

  void Add(size_t edge, const Eigen::Ref<const Eigen::VectorXd>& residuals,
           const Eigen::Ref<const Eigen::MatrixXd>& d_a,
           const Eigen::Ref<const Eigen::MatrixXd>& d_b) {
    const auto [a, b] = pairs_[edge];
    const Places& places = places_[edge];
    if (a >= 0) {
      AddTransposedProduct(1, d_a, residuals, gradient_.segment(a * size_, size_));
      AddBlock(a, places.aa, TransposedProduct(d_a, d_a), true);
    }
    if (b >= 0) {
      AddTransposedProduct(1, d_b, residuals, gradient_.segment(b * size_, size_));
      AddBlock(b, places.bb, TransposedProduct(d_b, d_b), true);
    }
    if (a < 0 || b < 0) return;
    if (a > b) {
      AddBlock(b, places.ab, TransposedProduct(d_a, d_b), false);
    } else {
      AddBlock(a, places.ab, TransposedProduct(d_b, d_a), false);
    }
  }

  std::optional<double> Solve(double damping, Eigen::VectorXd* step) {
    std::vector<double> before;
    for (const int place : diagonal_) {
      before.push_back(matrix_.valuePtr()[place]);
      matrix_.valuePtr()[place] *= 1 + damping;
    }
    const bool is_factored = solver_.Factorize(matrix_);
    for (size_t i = 0; i < diagonal_.size(); ++i) matrix_.valuePtr()[diagonal_[i]] = before[i];
    if (!is_factored) return std::nullopt;
    *step = solver_.Solve(-gradient_);
    if (!step->allFinite()) return std::nullopt;
    const Eigen::Map<const Eigen::VectorXd> diagonal(before.data(), step->size());
    return -gradient_.dot(*step) + damping * step->dot(diagonal.cwiseProduct(*step));
  }

 private:
  // Where the first row of a block lies in the first of its columns.
  struct Places {
    int aa, bb, ab;
  };

  void MakePattern(int blocks) {
    std::vector<Eigen::Triplet<double>> triplets;
    const auto add = [&](int row, int column) {
      for (int c = 0; c < size_; ++c) {
        for (int r = row == column ? c : 0; r < size_; ++r) {
          triplets.emplace_back(row * size_ + r, column * size_ + c, 0.0);
        }
      }
    };
    for (int block = 0; block < blocks; ++block) add(block, block);
    for (const auto& [a, b] : pairs_) {
      if (a >= 0 && b >= 0) add(std::max(a, b), std::min(a, b));
    }
    matrix_.resize(blocks * size_, blocks * size_);
    matrix_.setFromTriplets(triplets.begin(), triplets.end());
    matrix_.makeCompressed();
  }

  // All columns of a block column hold the same rows below their diagonal, so that a place in the
  // first column gives those in the others.
  int PlaceOf(int row, int column) const {
    const int* begin = matrix_.innerIndexPtr() + matrix_.outerIndexPtr()[column * size_];
    const int* end = matrix_.innerIndexPtr() + matrix_.outerIndexPtr()[column * size_ + 1];
    return static_cast<int>(std::lower_bound(begin, end, row * size_) - begin);
  }

  void AddBlock(int column, int place, const Eigen::MatrixXd& block, bool is_diagonal) {
    for (int c = 0; c < size_; ++c) {
      // Column c has lost the c rows above its diagonal.
      double* values = matrix_.valuePtr() + matrix_.outerIndexPtr()[column * size_ + c] + place - c;
      for (int r = is_diagonal ? c : 0; r < size_; ++r) values[r] += block(r, c);
    }
  }

  const int size_;
  const std::vector<std::pair<int, int>> pairs_;
  std::vector<Places> places_;  // parallel to pairs_
  std::vector<int> diagonal_;
  Eigen::SparseMatrix<double> matrix_;  // lower half
  Eigen::VectorXd gradient_;
  // Nested dissection suits graphs that fill a volume, minimum degree the others.
  SparseCholesky solver_{SparseCholesky::Ordering::kThorough};
};

NormalEquations::NormalEquations(int blocks, int block_size,
                                 std::span<const std::pair<int, int>> pairs)
    : impl_(std::make_unique<Impl>(blocks, block_size, pairs)) {}
NormalEquations::~NormalEquations() = default;

void NormalEquations::SetZero() { impl_->SetZero(); }

void NormalEquations::Add(size_t edge, const Eigen::Ref<const Eigen::VectorXd>& residuals,
                          const Eigen::Ref<const Eigen::MatrixXd>& d_a,
                          const Eigen::Ref<const Eigen::MatrixXd>& d_b) {
  impl_->Add(edge, residuals, d_a, d_b);
}

std::optional<double> NormalEquations::Solve(double damping, Eigen::VectorXd* step) {
  return impl_->Solve(damping, step);
}

}  // namespace portolan
