#include "common/linear_algebra/dense.h"

#include <Eigen/LU>
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

TEST(Dense, ProductsEqualTheirSums) {
  const MatrixXd a = RandomMatrix(4, 3, 1), b = RandomMatrix(3, 5, 2);
  MatrixXd expected = MatrixXd::Zero(4, 5);
  for (int i = 0; i < 4; ++i) {
    for (int j = 0; j < 5; ++j) {
      for (int k = 0; k < 3; ++k) expected(i, j) += a(i, k) * b(k, j);
    }
  }
  EXPECT_THAT(Product(a, b), NearMatrix(expected, 1e-14));
  EXPECT_THAT(TransposedProduct(a.transpose().eval(), b), NearMatrix(expected, 1e-14));
  EXPECT_THAT(ProductTransposed(a, b.transpose().eval()), NearMatrix(expected, 1e-14));
}

TEST(Dense, CongruenceMapsACovariance) {
  const MatrixXd a = RandomMatrix(2, 3, 1), p = RandomPositiveDefinite(3, 2);
  EXPECT_THAT(Congruence(a, p), NearMatrix(a * p * a.transpose(), 1e-13));
}

TEST(Dense, AddsProductsToABlock) {
  const MatrixXd a = RandomMatrix(30, 40, 1), b = RandomMatrix(40, 30, 2);
  const MatrixXd start = RandomMatrix(50, 50, 3);
  MatrixXd sum = start;
  AddProduct(-2, a, b, sum.block(10, 5, 30, 30));
  AddTransposedProduct(3, b, a.transpose().eval(), sum.block(10, 5, 30, 30));
  AddProductTransposed(0.5, a, b.transpose().eval(), sum.block(10, 5, 30, 30));
  MatrixXd expected = start;
  expected.block(10, 5, 30, 30) += -2 * (a * b) + 3 * (b.transpose() * a.transpose()) + 0.5 * a * b;
  EXPECT_THAT(sum, NearMatrix(expected, 1e-12));
}

TEST(Dense, SymmetriseTakesTheMean) {
  MatrixXd a(2, 2);
  a << 1, 2, 4, 3;
  Symmetrise(a);
  MatrixXd expected(2, 2);
  expected << 1, 3, 3, 3;
  EXPECT_THAT(a, NearMatrix(expected, 0));
}

TEST(Dense, CholeskyFactorOfABlock) {
  const MatrixXd p = RandomPositiveDefinite(6, 1);
  MatrixXd storage = MatrixXd::Constant(9, 9, 7);
  storage.block(2, 2, 6, 6) = p;
  ASSERT_TRUE(FactorCholesky(storage.block(2, 2, 6, 6)));
  const MatrixXd l = storage.block(2, 2, 6, 6).triangularView<Eigen::Lower>();
  EXPECT_THAT(l * l.transpose(), NearMatrix(p, 1e-13));
  EXPECT_EQ(storage(8, 8), 7);

  VectorXd x = RandomMatrix(6, 1, 2);
  const VectorXd right = l * x;
  VectorXd solved = right;
  SolveLower(storage.block(2, 2, 6, 6), solved);
  EXPECT_THAT(solved, NearMatrix(x, 1e-13));
}

TEST(Dense, SolvesPositiveDefiniteSystems) {
  const MatrixXd p = RandomPositiveDefinite(7, 1), x = RandomMatrix(7, 2, 2);
  MatrixXd solved = p * x;
  EXPECT_TRUE(SolvePositiveDefinite(p, solved));
  EXPECT_THAT(solved, NearMatrix(x, 1e-12));
  solved = p * x;
  EXPECT_TRUE(SolveSymmetric(p, solved));
  EXPECT_THAT(solved, NearMatrix(x, 1e-12));
}

TEST(Dense, RefusesIndefiniteMatrices) {
  MatrixXd indefinite = MatrixXd::Identity(3, 3);
  indefinite(1, 1) = -1;
  VectorXd x = VectorXd::Ones(3);
  EXPECT_FALSE(SolvePositiveDefinite(indefinite, x));
  x.setOnes();
  EXPECT_FALSE(SolveSymmetric(indefinite, x));
  EXPECT_EQ(NormalisedSquare(VectorXd::Ones(3), indefinite),
            std::numeric_limits<double>::infinity());
  EXPECT_FALSE(FactorCholesky(indefinite));
}

TEST(Dense, SolveSymmetricLeavesUnknownDirectionsZero) {
  MatrixXd singular = MatrixXd::Zero(3, 3);
  singular(0, 0) = 2;
  VectorXd x = VectorXd::Constant(3, 4);
  EXPECT_TRUE(SolveSymmetric(singular, x));
  EXPECT_THAT(x, NearMatrix(Eigen::Vector3d(2, 0, 0), 1e-15));
}

TEST(Dense, NormalisedSquareUsesTheInverse) {
  const MatrixXd p = RandomPositiveDefinite(7, 1);
  const VectorXd e = RandomMatrix(7, 1, 2);
  EXPECT_NEAR(NormalisedSquare(e, p), e.dot(p.inverse() * e), 1e-12);
}

TEST(Dense, InverseIsExactlySymmetric) {
  const Eigen::Matrix<double, 7, 7> p = RandomPositiveDefinite(7, 3);
  const Eigen::Matrix<double, 7, 7> inverse = InverseOfPositiveDefinite(p);
  EXPECT_THAT(inverse * p, NearMatrix(MatrixXd::Identity(7, 7), 1e-12));
  EXPECT_TRUE((inverse.array() == inverse.transpose().array()).all());
}

TEST(Dense, EigenvectorsRebuildTheMatrix) {
  const MatrixXd p = RandomPositiveDefinite(6, 1);
  const SymmetricEigen eigen = DecomposeSymmetric(p);
  EXPECT_THAT(eigen.vectors * eigen.values.asDiagonal() * eigen.vectors.transpose(),
              NearMatrix(p, 1e-12));
  for (int i = 1; i < 6; ++i) EXPECT_LE(eigen.values[i - 1], eigen.values[i]);
}

}  // namespace
}  // namespace portolan
