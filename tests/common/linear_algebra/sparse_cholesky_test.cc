#include "common/linear_algebra/sparse_cholesky.h"

#include <gtest/gtest.h>

#include <vector>

namespace portolan {
namespace {

using Sparse = Eigen::SparseMatrix<double>;

constexpr int kSize = 40;

// A chain with some loops; `diagonal` above six makes it positive definite. Lower triangle.
Sparse Chain(double diagonal) {
  std::vector<Eigen::Triplet<double>> entries;
  for (int i = 0; i < kSize; ++i) {
    entries.emplace_back(i, i, diagonal + 0.1 * i);
    if (i >= 1) entries.emplace_back(i, i - 1, -1);
    if (i >= 17) entries.emplace_back(i, i - 17, 2);
  }
  Sparse matrix(kSize, kSize);
  matrix.setFromTriplets(entries.begin(), entries.end());
  return matrix;
}

Eigen::VectorXd Known() { return Eigen::VectorXd::LinSpaced(kSize, -1, 2); }

double ErrorOf(const SparseCholesky& cholesky, const Sparse& matrix) {
  const Eigen::VectorXd right = matrix.selfadjointView<Eigen::Lower>() * Known();
  return (cholesky.Solve(right) - Known()).norm();
}

TEST(SparseCholesky, SolvesMatricesOfTheAnalysedPattern) {
  for (const auto ordering :
       {SparseCholesky::Ordering::kQuick, SparseCholesky::Ordering::kThorough}) {
    SparseCholesky cholesky(ordering);
    cholesky.Analyze(Chain(7));
    for (const double diagonal : {7.0, 70.0}) {
      ASSERT_TRUE(cholesky.Factorize(Chain(diagonal)));
      EXPECT_LT(ErrorOf(cholesky, Chain(diagonal)), 1e-12);
    }
  }
}

TEST(SparseCholesky, RefusesWhatIsNotPositiveDefiniteAndGoesOn) {
  SparseCholesky cholesky;
  cholesky.Analyze(Chain(7));
  EXPECT_FALSE(cholesky.Factorize(Chain(-1)));
  ASSERT_TRUE(cholesky.Factorize(Chain(7)));
  EXPECT_LT(ErrorOf(cholesky, Chain(7)), 1e-12);
}

TEST(SparseCholesky, TakesANewPattern) {
  SparseCholesky cholesky;
  cholesky.Analyze(Chain(7));
  ASSERT_TRUE(cholesky.Factorize(Chain(7)));
  Sparse other(3, 3);
  other.insert(0, 0) = 2;
  other.insert(1, 1) = 4;
  other.insert(2, 0) = 1;
  other.insert(2, 2) = 8;
  cholesky.Analyze(other);
  ASSERT_TRUE(cholesky.Factorize(other));
  const Eigen::Vector3d known(1, -2, 3);
  const Eigen::VectorXd right = other.selfadjointView<Eigen::Lower>() * known;
  EXPECT_LT((cholesky.Solve(right) - known).norm(), 1e-14);
}

}  // namespace
}  // namespace portolan
