#include "common/linear_algebra/dense.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <cmath>
#include <limits>

namespace portolan {

Eigen::MatrixXd Product(const ConstMatrixView& a, const ConstMatrixView& b) {
  Eigen::MatrixXd product = Eigen::MatrixXd::Zero(a.rows(), b.cols());
  AddProduct(1, a, b, product);
  return product;
}

Eigen::MatrixXd TransposedProduct(const ConstMatrixView& a, const ConstMatrixView& b) {
  Eigen::MatrixXd product = Eigen::MatrixXd::Zero(a.cols(), b.cols());
  AddTransposedProduct(1, a, b, product);
  return product;
}

Eigen::MatrixXd ProductTransposed(const ConstMatrixView& a, const ConstMatrixView& b) {
  Eigen::MatrixXd product = Eigen::MatrixXd::Zero(a.rows(), b.rows());
  AddProductTransposed(1, a, b, product);
  return product;
}

Eigen::MatrixXd Congruence(const ConstMatrixView& a, const ConstMatrixView& p) {
  return ProductTransposed(Product(a, p), a);
}

void AddProduct(double factor, const ConstMatrixView& a, const ConstMatrixView& b, MatrixView sum) {
  sum.noalias() += factor * a * b;
}

void AddTransposedProduct(double factor, const ConstMatrixView& a, const ConstMatrixView& b,
                          MatrixView sum) {
  sum.noalias() += factor * a.transpose() * b;
}

void AddProductTransposed(double factor, const ConstMatrixView& a, const ConstMatrixView& b,
                          MatrixView sum) {
  sum.noalias() += factor * a * b.transpose();
}

void SetToProduct(const ConstMatrixView& a, const ConstMatrixView& b, MatrixView product) {
  product.setZero();
  AddProduct(1, a, b, product);
}

void SetToProductTransposed(const ConstMatrixView& a, const ConstMatrixView& b,
                            MatrixView product) {
  product.setZero();
  AddProductTransposed(1, a, b, product);
}

void AddGram(double factor, const ConstMatrixView& w, MatrixView p) {
  p.selfadjointView<Eigen::Lower>().rankUpdate(w.transpose(), factor);
  p.triangularView<Eigen::StrictlyUpper>() = p.transpose();
}

void Symmetrise(MatrixView a) {
  for (Eigen::Index column = 0; column < a.cols(); ++column) {
    for (Eigen::Index row = column + 1; row < a.rows(); ++row) {
      a(row, column) = a(column, row) = 0.5 * (a(row, column) + a(column, row));
    }
  }
}

bool FactorCholesky(MatrixView a) {
  const Eigen::LLT<MatrixView> factor(a);
  return factor.info() == Eigen::Success;
}

void SolveLower(const ConstMatrixView& l, MatrixView x) {
  l.triangularView<Eigen::Lower>().solveInPlace(x);
}

void SolveFactored(const ConstMatrixView& l, MatrixView x) {
  SolveLower(l, x);
  l.triangularView<Eigen::Lower>().transpose().solveInPlace(x);
}

Eigen::Matrix2d CholeskyFactor(const Eigen::Matrix2d& a) {
  Eigen::Matrix2d l = Eigen::Matrix2d::Zero();
  l(0, 0) = std::sqrt(a(0, 0));
  l(1, 0) = a(1, 0) / l(0, 0);
  l(1, 1) = std::sqrt(a(1, 1) - l(1, 0) * l(1, 0));
  return l;
}

bool SolvePositiveDefinite(const ConstMatrixView& a, MatrixView x) {
  Eigen::MatrixXd factor = a;
  const bool positive = FactorCholesky(factor);
  SolveFactored(factor, x);
  return positive;
}

bool SolveSymmetric(const ConstMatrixView& a, MatrixView x) {
  const Eigen::LDLT<Eigen::MatrixXd> factor(a);
  x = factor.solve(x).eval();
  return factor.info() == Eigen::Success && factor.isPositive();
}

double NormalisedSquare(const Eigen::Ref<const Eigen::VectorXd>& e, const ConstMatrixView& a) {
  Eigen::MatrixXd factor = a;
  if (!FactorCholesky(factor)) return std::numeric_limits<double>::infinity();
  Eigen::VectorXd whitened = e;
  SolveLower(factor, whitened);
  return whitened.squaredNorm();
}

SymmetricEigen DecomposeSymmetric(const ConstMatrixView& a) {
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(a);
  return {solver.eigenvalues(), solver.eigenvectors()};
}

}  // namespace portolan
