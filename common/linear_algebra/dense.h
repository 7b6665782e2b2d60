// Products and decompositions of dense matrices, compiled once. Eigen compiles them anew for every
// combination of operand types, which costs seconds each; where the operands are few and small or
// the product is not in an inner loop, these functions take views of them instead.
#ifndef PORTOLAN_COMMON_LINEAR_ALGEBRA_DENSE_H_
#define PORTOLAN_COMMON_LINEAR_ALGEBRA_DENSE_H_

#include <Eigen/Core>

namespace portolan {

// Matrices, blocks of them and column vectors, of any size, convert to these without a copy.
using MatrixView = Eigen::Ref<Eigen::MatrixXd>;
using ConstMatrixView = Eigen::Ref<const Eigen::MatrixXd>;

// A B, A' B, A B' and A P A'.
Eigen::MatrixXd Product(const ConstMatrixView& a, const ConstMatrixView& b);
Eigen::MatrixXd TransposedProduct(const ConstMatrixView& a, const ConstMatrixView& b);
Eigen::MatrixXd ProductTransposed(const ConstMatrixView& a, const ConstMatrixView& b);
Eigen::MatrixXd Congruence(const ConstMatrixView& a, const ConstMatrixView& p);

// sum += factor A B, the same with A' B and with A B'. `sum` overlaps neither A nor B.
void AddProduct(double factor, const ConstMatrixView& a, const ConstMatrixView& b, MatrixView sum);
void AddTransposedProduct(double factor, const ConstMatrixView& a, const ConstMatrixView& b,
                          MatrixView sum);
void AddProductTransposed(double factor, const ConstMatrixView& a, const ConstMatrixView& b,
                          MatrixView sum);

// product := A B, and the same with B'; allocates nothing.
void SetToProduct(const ConstMatrixView& a, const ConstMatrixView& b, MatrixView product);
void SetToProductTransposed(const ConstMatrixView& a, const ConstMatrixView& b, MatrixView product);

// p += factor W' W, for a symmetric p; only its lower triangle is read.
void AddGram(double factor, const ConstMatrixView& w, MatrixView p);

// a := (A + A') / 2.
void Symmetrise(MatrixView a);

// A = L L', L into the lower triangle of a. False unless A is positive definite. Reads the lower
// triangle only.
bool FactorCholesky(MatrixView a);
// X := L^-1 X, L in the lower triangle of l.
void SolveLower(const ConstMatrixView& l, MatrixView x);
// X := (L L')^-1 X.
void SolveFactored(const ConstMatrixView& l, MatrixView x);
// L of a 2x2 matrix; the last entry is not above zero unless A is positive definite.
Eigen::Matrix2d CholeskyFactor(const Eigen::Matrix2d& a);
// X := A^-1 X by Cholesky; false, and X without meaning, unless A is positive definite.
bool SolvePositiveDefinite(const ConstMatrixView& a, MatrixView x);
// X := A^-1 X for a symmetric A that may be nearly singular (L D L' with pivots). False unless A
// is positive semi-definite; directions of no information stay zero.
bool SolveSymmetric(const ConstMatrixView& a, MatrixView x);

// e' A^-1 e; infinite unless A is positive definite.
double NormalisedSquare(const Eigen::Ref<const Eigen::VectorXd>& e, const ConstMatrixView& a);

// By Cholesky, exactly symmetric; without meaning unless A is positive definite.
template <int N>
Eigen::Matrix<double, N, N> InverseOfPositiveDefinite(const Eigen::Matrix<double, N, N>& a) {
  Eigen::Matrix<double, N, N> inverse;
  inverse.setIdentity(a.rows(), a.cols());
  SolvePositiveDefinite(a, inverse);
  Symmetrise(inverse);
  return inverse;
}

// A = V diag(values) V', the values ascending. Reads the lower triangle only.
struct SymmetricEigen {
  Eigen::VectorXd values;
  Eigen::MatrixXd vectors;
};
SymmetricEigen DecomposeSymmetric(const ConstMatrixView& a);

}  // namespace portolan

#endif  // PORTOLAN_COMMON_LINEAR_ALGEBRA_DENSE_H_
