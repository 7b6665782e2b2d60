// Cholesky factor, triangular solve and product of a matrix with its transpose, for matrices of a
// few hundred rows: a Kalman update. Written for four numbers at once where the processor can
// (vector_clones.h); Eigen is compiled for two. Same bits either way.
#ifndef PORTOLAN_COMMON_LINEAR_ALGEBRA_PACKED_ROWS_H_
#define PORTOLAN_COMMON_LINEAR_ALGEBRA_PACKED_ROWS_H_

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "common/linear_algebra/dense.h"

namespace portolan {

// A matrix by groups of eight rows, the columns of a group one after another in memory; so the
// loops below read it in order. Keeps its memory. Thread-compatible.
class PackedRows {
 public:
  static constexpr int kGroup = 8;  // rows
  static constexpr int kTile = 4;   // columns that are computed at once

  // All zero.
  void SetZero(int rows, int cols);
  int rows() const { return rows_; }
  int cols() const { return cols_; }
  double& operator()(int row, int col) { return Column(row / kGroup, col)[row % kGroup]; }
  double operator()(int row, int col) const { return Column(row / kGroup, col)[row % kGroup]; }

  // The first rows, all columns.
  void SetTopRows(const ConstMatrixView& rows);
  Eigen::MatrixXd TopRows(int count) const;
  Eigen::VectorXd Row(int row) const;

  // Counts and eight numbers with those that fill up the last group and tile, which are zero.
  int groups() const { return groups_; }
  int padded_cols() const { return padded_cols_; }
  double* Column(int group, int col) { return values_[Index(group, col)].row; }
  const double* Column(int group, int col) const { return values_[Index(group, col)].row; }

 private:
  struct alignas(64) Eight {
    double row[kGroup];
  };
  size_t Index(int group, int col) const { return static_cast<size_t>(group) * padded_cols_ + col; }

  int rows_ = 0, cols_ = 0, groups_ = 0, padded_cols_ = 0;
  std::vector<Eight> values_;
};

// A = L L', L into the lower triangle of a; what is above has no meaning. False unless A is
// positive definite. Reads the lower triangle only.
bool FactorCholesky(PackedRows* a);
// X := X L^-T, the transpose of L^-1 X'.
void SolveRight(const PackedRows& l, PackedRows* x);
// p -= W W', W the first p.rows() rows of w. Reads the lower triangle of p, sets all of it.
void SubtractGram(const PackedRows& w, MatrixView p);
// The first sum.size() entries of W x.
void SetToProduct(const PackedRows& w, const Eigen::VectorXd& x, Eigen::Ref<Eigen::VectorXd> sum);

// The lower triangle of p -= A B' for matrices of three columns and as many rows as p, which are
// `stride` numbers apart; above the diagonal p is spoilt.
void SubtractProductOfThree(const double* a, const double* b, ptrdiff_t stride, MatrixView p);

// Two linear combinations of columns: sums[k] = sum over i of columns[i] * weights[i][k].
struct WeightedColumn {
  const double* column;
  double weights[2];
};
void CombineColumns(const WeightedColumn* columns, int count, int rows, double* sum_0,
                    double* sum_1);

}  // namespace portolan

#endif  // PORTOLAN_COMMON_LINEAR_ALGEBRA_PACKED_ROWS_H_
