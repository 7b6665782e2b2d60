#include "common/linear_algebra/sparse_cholesky.h"

#include <omp.h>

#include <Eigen/CholmodSupport>

namespace portolan {

class SparseCholesky::Impl
    : public Eigen::CholmodDecomposition<Eigen::SparseMatrix<double>, Eigen::Lower> {};

SparseCholesky::SparseCholesky(Ordering ordering) : impl_(std::make_unique<Impl>()) {
  impl_->cholmod().print = 0;
  if (ordering == Ordering::kQuick) return;
  impl_->cholmod().nmethods = 2;
  impl_->cholmod().method[0].ordering = CHOLMOD_AMD;
  impl_->cholmod().method[1].ordering = CHOLMOD_METIS;
  impl_->cholmod().postorder = 1;
}

SparseCholesky::~SparseCholesky() = default;

void SparseCholesky::Analyze(const Eigen::SparseMatrix<double>& pattern) {
  impl_->analyzePattern(pattern);
}

bool SparseCholesky::Factorize(const Eigen::SparseMatrix<double>& matrix) {
  // Debian's CHOLMOD shares every supernode among four threads, which then spin while they wait for
  // the next one: several times the processor time and, with other work on the machine, later. The
  // setting belongs to this thread.
  omp_set_max_active_levels(0);
  impl_->factorize(matrix);
  return impl_->info() == Eigen::Success;
}

Eigen::VectorXd SparseCholesky::Solve(const Eigen::VectorXd& right) const {
  return impl_->solve(right);
}

}  // namespace portolan
