// Cholesky factors of sparse matrices, by CHOLMOD, on the calling thread alone.
#ifndef PORTOLAN_COMMON_LINEAR_ALGEBRA_SPARSE_CHOLESKY_H_
#define PORTOLAN_COMMON_LINEAR_ALGEBRA_SPARSE_CHOLESKY_H_

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <memory>

namespace portolan {

// Thread-compatible.
class SparseCholesky {
 public:
  enum class Ordering {
    kQuick,     // minimum degree, nested dissection where that fills in much
    kThorough,  // both, for patterns that are analysed once; the better one is taken
  };

  explicit SparseCholesky(Ordering ordering = Ordering::kQuick);
  ~SparseCholesky();

  // Of matrices, all lower triangles, that have the pattern of this one.
  void Analyze(const Eigen::SparseMatrix<double>& pattern);
  // False unless the matrix, of the pattern analysed last, is positive definite.
  bool Factorize(const Eigen::SparseMatrix<double>& matrix);
  // By the last factor.
  Eigen::VectorXd Solve(const Eigen::VectorXd& right) const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace portolan

#endif  // PORTOLAN_COMMON_LINEAR_ALGEBRA_SPARSE_CHOLESKY_H_
