#include "common/linear_algebra/packed_rows.h"

#include <cstdlib>
#include <limits>

#include "tests/support/matchers.h"

namespace portolan {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

MatrixXd RandomMatrix(int rows, int columns, unsigned seed) {
  std::srand(seed);
  return MatrixXd::Random(rows, columns);
}

MatrixXd RandomPositiveDefinite(int size, unsigned seed) {
  const MatrixXd root = RandomMatrix(size, size, seed);
  return root * root.transpose() + MatrixXd::Identity(size, size);
}

PackedRows Packed(const MatrixXd& matrix) {
  PackedRows packed;
  packed.SetZero(static_cast<int>(matrix.rows()), static_cast<int>(matrix.cols()));
  packed.SetTopRows(matrix);
  return packed;
}

// Sizes that fill groups and tiles, and such that do not.
class PackedRowsOfSize : public testing::TestWithParam<int> {};

TEST_P(PackedRowsOfSize, HoldsItsRows) {
  const MatrixXd a = RandomMatrix(GetParam(), 7, 1);
  const PackedRows packed = Packed(a);
  EXPECT_THAT(packed.TopRows(GetParam()), NearMatrix(a, 0));
  EXPECT_THAT(packed.Row(GetParam() - 1), NearMatrix(a.row(GetParam() - 1).transpose().eval(), 0));
}

TEST_P(PackedRowsOfSize, FactorsTheLowerTriangle) {
  const int size = GetParam();
  const MatrixXd p = RandomPositiveDefinite(size, 1);
  MatrixXd lower = p.triangularView<Eigen::Lower>();
  lower.triangularView<Eigen::StrictlyUpper>().setConstant(1e9);
  PackedRows packed = Packed(lower);
  ASSERT_TRUE(FactorCholesky(&packed));
  const MatrixXd l = packed.TopRows(size).triangularView<Eigen::Lower>();
  EXPECT_THAT(l * l.transpose(), NearMatrix(p, 1e-12 * size));
}

TEST_P(PackedRowsOfSize, SolvesFromTheRight) {
  const int size = GetParam();
  PackedRows l = Packed(RandomPositiveDefinite(size, 1));
  ASSERT_TRUE(FactorCholesky(&l));
  const MatrixXd lower = l.TopRows(size).triangularView<Eigen::Lower>();
  const MatrixXd expected = RandomMatrix(13, size, 2);
  PackedRows x = Packed(expected * lower.transpose());
  SolveRight(l, &x);
  EXPECT_THAT(x.TopRows(13), NearMatrix(expected, 1e-11 * size));
}

TEST_P(PackedRowsOfSize, SubtractsItsGramFromABlock) {
  const int size = GetParam();
  const MatrixXd w = RandomMatrix(size + 1, 11, 1);
  const MatrixXd start = RandomMatrix(size + 9, size + 9, 2);
  MatrixXd p = start;
  SubtractGram(Packed(w), p.block(4, 5, size, size));
  MatrixXd expected = start;
  auto block = expected.block(4, 5, size, size);
  block -= w.topRows(size) * w.topRows(size).transpose();
  block.triangularView<Eigen::StrictlyUpper>() = MatrixXd(block).transpose();
  EXPECT_THAT(p, NearMatrix(expected, 1e-13));
  EXPECT_TRUE(
      (p.block(4, 5, size, size).array() == p.block(4, 5, size, size).transpose().array()).all());
}

TEST_P(PackedRowsOfSize, MultipliesAVector) {
  const MatrixXd w = RandomMatrix(GetParam() + 2, 6, 1);
  const VectorXd x = RandomMatrix(6, 1, 2);
  VectorXd sum = VectorXd::Constant(GetParam() + 1, 7);
  SetToProduct(Packed(w), x, sum.head(GetParam()));
  EXPECT_THAT(sum.head(GetParam()).eval(), NearMatrix((w * x).head(GetParam()).eval(), 1e-14));
  EXPECT_EQ(sum[GetParam()], 7);
}

TEST_P(PackedRowsOfSize, SubtractsAProductFromTheLowerTriangle) {
  const int size = GetParam();
  const MatrixXd a = RandomMatrix(size + 3, 3, 1), b = RandomMatrix(size + 3, 3, 2);
  const MatrixXd start = RandomMatrix(size + 5, size + 5, 3);
  MatrixXd p = start;
  SubtractProductOfThree(a.data(), b.data(), size + 3, p.block(2, 1, size, size));
  const MatrixXd expected =
      start.block(2, 1, size, size) - a.topRows(size) * b.topRows(size).transpose();
  const MatrixXd difference = p.block(2, 1, size, size) - expected;
  EXPECT_LT(MatrixXd(difference.triangularView<Eigen::Lower>()).norm(), 1e-13);
  p.block(2, 1, size, size) = start.block(2, 1, size, size);
  EXPECT_THAT(p, NearMatrix(start, 0));  // nothing beyond the block
}

TEST_P(PackedRowsOfSize, CombinesColumns) {
  const int size = GetParam();
  const MatrixXd columns = RandomMatrix(size, 3, 1), weights = RandomMatrix(3, 2, 2);
  MatrixXd sums = MatrixXd::Constant(size + 1, 2, 7);
  WeightedColumn weighted[3];
  for (int i = 0; i < 3; ++i) weighted[i] = {&columns(0, i), {weights(i, 0), weights(i, 1)}};
  CombineColumns(weighted, 3, size, &sums(0, 0), &sums(0, 1));
  MatrixXd expected = MatrixXd::Constant(size + 1, 2, 7);
  expected.topRows(size) = columns * weights;
  EXPECT_THAT(sums, NearMatrix(expected, 1e-14));
}

INSTANTIATE_TEST_SUITE_P(Sizes, PackedRowsOfSize, testing::Values(1, 2, 4, 5, 8, 12, 13, 24, 46));

TEST(PackedRows, RefusesIndefiniteMatrices) {
  for (int i = 0; i < 11; ++i) {
    MatrixXd indefinite = MatrixXd::Identity(11, 11);
    indefinite(i, i) = -1;
    PackedRows packed = Packed(indefinite);
    EXPECT_FALSE(FactorCholesky(&packed)) << i;
  }
  MatrixXd undefined = MatrixXd::Identity(6, 6);
  undefined(5, 5) = std::numeric_limits<double>::quiet_NaN();
  PackedRows packed = Packed(undefined);
  EXPECT_FALSE(FactorCholesky(&packed));
}

}  // namespace
}  // namespace portolan
