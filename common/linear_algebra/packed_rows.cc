#include "common/linear_algebra/packed_rows.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "common/base/vector_clones.h"

namespace portolan {
namespace {

constexpr int kGroup = PackedRows::kGroup, kTile = PackedRows::kTile;

// Eight rows of four columns.
struct Tile {
  Double4 low[kTile], high[kTile];
};

PORTOLAN_INLINE void Load(const double* eight, Double4* low, Double4* high) {
  std::memcpy(low, eight, sizeof(*low));
  std::memcpy(high, eight + 4, sizeof(*high));
}

PORTOLAN_INLINE void Store(const Double4& low, const Double4& high, double* eight) {
  std::memcpy(eight, &low, sizeof(low));
  std::memcpy(eight + 4, &high, sizeof(high));
}

// The product of `count` columns of a group with the transpose of four rows of a group.
PORTOLAN_INLINE void Multiply(const double* group, const double* four_rows, int count, Tile* tile) {
  Double4 low_0 = {}, low_1 = {}, low_2 = {}, low_3 = {};
  Double4 high_0 = {}, high_1 = {}, high_2 = {}, high_3 = {};
  for (int k = 0; k < count; ++k, group += kGroup, four_rows += kGroup) {
    Double4 low, high;
    Load(group, &low, &high);
    low_0 += low * four_rows[0];
    high_0 += high * four_rows[0];
    low_1 += low * four_rows[1];
    high_1 += high * four_rows[1];
    low_2 += low * four_rows[2];
    high_2 += high * four_rows[2];
    low_3 += low * four_rows[3];
    high_3 += high * four_rows[3];
  }
  *tile = {{low_0, low_1, low_2, low_3}, {high_0, high_1, high_2, high_3}};
}

// `columns` (four of a group) minus what the columns before them explain.
PORTOLAN_INLINE void Reduce(const double* group, const double* four_rows, int first, Tile* tile) {
  Multiply(group, four_rows, first, tile);
  for (int c = 0; c < kTile; ++c) {
    Double4 low, high;
    Load(group + kGroup * (first + c), &low, &high);
    tile->low[c] = low - tile->low[c];
    tile->high[c] = high - tile->high[c];
  }
}

// Columns x with x L' = tile, L the lower triangle of 4 x 4 numbers at `triangle`, a column every
// kGroup.
PORTOLAN_INLINE void SolveTile(const double* triangle, Tile* tile) {
  for (int c = 0; c < kTile; ++c) {
    for (int d = 0; d < c; ++d) {
      tile->low[c] -= tile->low[d] * triangle[kGroup * d + c];
      tile->high[c] -= tile->high[d] * triangle[kGroup * d + c];
    }
    const double inverse = 1 / triangle[kGroup * c + c];
    tile->low[c] *= inverse;
    tile->high[c] *= inverse;
  }
}

PORTOLAN_INLINE void Store(const Tile& tile, double* columns) {
  for (int c = 0; c < kTile; ++c) Store(tile.low[c], tile.high[c], columns + kGroup * c);
}

// A = L L' of 4 x 4 numbers in place.
PORTOLAN_INLINE bool FactorTile(double* a) {
  for (int c = 0; c < kTile; ++c) {
    for (int r = c; r < kTile; ++r) {
      for (int d = 0; d < c; ++d) a[kGroup * c + r] -= a[kGroup * d + r] * a[kGroup * d + c];
    }
    const double pivot = a[kGroup * c + c];
    if (!(pivot > 0)) return false;
    const double root = std::sqrt(pivot);
    a[kGroup * c + c] = root;
    for (int r = c + 1; r < kTile; ++r) a[kGroup * c + r] /= root;
  }
  return true;
}

// Of eight rows and four columns of a symmetric matrix from (row, col), what is on and under the
// diagonal, and its mirror image.
PORTOLAN_INLINE void SubtractTile(const Tile& tile, int row, int col, MatrixView& p) {
  double values[kTile * kGroup];
  Store(tile, values);
  const int rows = std::min<int>(kGroup, p.rows() - row),
            cols = std::min<int>(kTile, p.cols() - col);
  for (int c = 0; c < cols; ++c) {
    double* column = &p(row, col + c);
    for (int r = std::max(0, col + c - row); r < rows; ++r) {
      column[r] -= values[kGroup * c + r];
      values[kGroup * c + r] = column[r];
    }
  }
  for (int r = 0; r < rows; ++r) {
    double* mirrored = &p(col, row + r);
    for (int c = 0; c < std::min(cols, row + r - col); ++c) mirrored[c] = values[kGroup * c + r];
  }
}

}  // namespace

void PackedRows::SetZero(int rows, int cols) {
  rows_ = rows;
  cols_ = cols;
  groups_ = (rows + kGroup - 1) / kGroup;
  padded_cols_ = (cols + kTile - 1) / kTile * kTile;
  values_.assign(static_cast<size_t>(groups_) * padded_cols_, Eight{});
}

void PackedRows::SetTopRows(const ConstMatrixView& rows) {
  const int count = static_cast<int>(rows.rows());
  for (int row = 0; row < count; row += kGroup) {
    const size_t bytes = sizeof(double) * std::min(kGroup, count - row);
    for (int col = 0; col < rows.cols(); ++col) {
      std::memcpy(Column(row / kGroup, col), rows.col(col).data() + row, bytes);
    }
  }
}

Eigen::MatrixXd PackedRows::TopRows(int count) const {
  Eigen::MatrixXd rows(count, cols_);
  for (int col = 0; col < cols_; ++col) {
    for (int row = 0; row < count; ++row) rows(row, col) = (*this)(row, col);
  }
  return rows;
}

Eigen::VectorXd PackedRows::Row(int row) const {
  Eigen::VectorXd values(cols_);
  for (int col = 0; col < cols_; ++col) values[col] = (*this)(row, col);
  return values;
}

PORTOLAN_VECTOR_CLONES bool FactorCholesky(PackedRows* a) {
  for (int col = 0; col < a->padded_cols(); col += kTile) {
    const int diagonal = col / kGroup, offset = col % kGroup;
    // What fills up the last tile is the identity's.
    for (int c = std::max(col, a->cols()); c < col + kTile; ++c) (*a)(c, c) = 1;
    double* triangle = a->Column(diagonal, col) + offset;
    for (int group = diagonal; group < a->groups(); ++group) {
      Tile tile;
      Reduce(a->Column(group, 0), a->Column(diagonal, 0) + offset, col, &tile);
      if (group == diagonal) {
        Store(tile, a->Column(group, col));
        if (!FactorTile(triangle)) return false;
        if (offset > 0) continue;
        // The four rows under the triangle.
        Double4 none;
        for (int c = 0; c < kTile; ++c) Load(a->Column(group, col + c), &none, &tile.high[c]);
        SolveTile(triangle, &tile);
        for (int c = 0; c < kTile; ++c) {
          std::memcpy(a->Column(group, col + c) + 4, &tile.high[c], sizeof(tile.high[c]));
        }
      } else {
        SolveTile(triangle, &tile);
        Store(tile, a->Column(group, col));
      }
    }
  }
  return true;
}

PORTOLAN_VECTOR_CLONES void SolveRight(const PackedRows& l, PackedRows* x) {
  for (int group = 0; group < x->groups(); ++group) {
    double* rows = x->Column(group, 0);
    for (int col = 0; col < x->padded_cols(); col += kTile) {
      const int diagonal = col / kGroup, offset = col % kGroup;
      Tile tile;
      Reduce(rows, l.Column(diagonal, 0) + offset, col, &tile);
      SolveTile(l.Column(diagonal, col) + offset, &tile);
      Store(tile, rows + kGroup * col);
    }
  }
}

PORTOLAN_VECTOR_CLONES void SubtractGram(const PackedRows& w, MatrixView p) {
  const int n = static_cast<int>(p.rows());
  for (int row = 0; row < n; row += kGroup) {
    for (int col = 0; col < std::min(n, row + kGroup); col += kTile) {
      Tile tile;
      Multiply(w.Column(row / kGroup, 0), w.Column(col / kGroup, 0) + col % kGroup, w.cols(),
               &tile);
      SubtractTile(tile, row, col, p);
    }
  }
}

PORTOLAN_VECTOR_CLONES void SetToProduct(const PackedRows& w, const Eigen::VectorXd& x,
                                         Eigen::Ref<Eigen::VectorXd> sum) {
  const int n = static_cast<int>(sum.size());
  for (int row = 0; row < n; row += kGroup) {
    Double4 low = {}, high = {};
    for (int col = 0; col < w.cols(); ++col) {
      Double4 column_low, column_high;
      Load(w.Column(row / kGroup, col), &column_low, &column_high);
      low += column_low * x[col];
      high += column_high * x[col];
    }
    double values[kGroup];
    Store(low, high, values);
    std::copy_n(values, std::min(kGroup, n - row), &sum[row]);
  }
}

PORTOLAN_VECTOR_CLONES void SubtractProductOfThree(const double* a, const double* b,
                                                   ptrdiff_t stride, MatrixView p) {
  const int n = static_cast<int>(p.rows());
  for (int col = 0; col < n; ++col, ++b) {
    const double b_0 = b[0], b_1 = b[stride], b_2 = b[2 * stride];
    int row = col / 4 * 4;
    double* to = &p(row, col);
    const double *from_0 = a + row, *from_1 = from_0 + stride, *from_2 = from_1 + stride;
    for (; row + 4 <= n; row += 4, to += 4, from_0 += 4, from_1 += 4, from_2 += 4) {
      Double4 a_0, a_1, a_2, sum;
      std::memcpy(&a_0, from_0, sizeof(a_0));
      std::memcpy(&a_1, from_1, sizeof(a_1));
      std::memcpy(&a_2, from_2, sizeof(a_2));
      std::memcpy(&sum, to, sizeof(sum));
      sum -= a_0 * b_0 + a_1 * b_1 + a_2 * b_2;
      std::memcpy(to, &sum, sizeof(sum));
    }
    for (; row < n; ++row) *to++ -= *from_0++ * b_0 + *from_1++ * b_1 + *from_2++ * b_2;
  }
}

PORTOLAN_VECTOR_CLONES void CombineColumns(const WeightedColumn* columns, int count, int rows,
                                           double* sum_0, double* sum_1) {
  int row = 0;
  for (; row + kGroup <= rows; row += kGroup) {
    Double4 low_0 = {}, high_0 = {}, low_1 = {}, high_1 = {};
    for (int i = 0; i < count; ++i) {
      Double4 low, high;
      Load(columns[i].column + row, &low, &high);
      low_0 += low * columns[i].weights[0];
      high_0 += high * columns[i].weights[0];
      low_1 += low * columns[i].weights[1];
      high_1 += high * columns[i].weights[1];
    }
    Store(low_0, high_0, sum_0 + row);
    Store(low_1, high_1, sum_1 + row);
  }
  for (; row < rows; ++row) {
    sum_0[row] = sum_1[row] = 0;
    for (int i = 0; i < count; ++i) {
      sum_0[row] += columns[i].column[row] * columns[i].weights[0];
      sum_1[row] += columns[i].column[row] * columns[i].weights[1];
    }
  }
}

}  // namespace portolan
