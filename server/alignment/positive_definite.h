// Small helper for covariances and information matrices of similarities.
#ifndef PORTOLAN_SERVER_ALIGNMENT_POSITIVE_DEFINITE_H_
#define PORTOLAN_SERVER_ALIGNMENT_POSITIVE_DEFINITE_H_

#include <Eigen/Cholesky>

#include "common/geometry/similarity3.h"

namespace portolan {

// Inverse of a positive definite matrix, exactly symmetric.
inline Matrix7d InverseOfPositiveDefinite(const Matrix7d& positive_definite) {
  const Matrix7d inverse = positive_definite.llt().solve(Matrix7d::Identity());
  return 0.5 * (inverse + inverse.transpose());
}

}  // namespace portolan

#endif  // PORTOLAN_SERVER_ALIGNMENT_POSITIVE_DEFINITE_H_
