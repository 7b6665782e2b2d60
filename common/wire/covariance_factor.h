// Covariances travel as float32 Cholesky factors: rounding a factor keeps the product positive
// (semi-)definite, rounding the covariance itself does not.
#ifndef PORTOLAN_COMMON_WIRE_COVARIANCE_FACTOR_H_
#define PORTOLAN_COMMON_WIRE_COVARIANCE_FACTOR_H_

#include <optional>

#include "common/geometry/rotation3.h"

namespace portolan {

// Lower triangular L with covariance = L L'. Directions without variance get a zero column. No
// value if the matrix is not finite, not symmetric to within 1e-6 of its scale, or has a
// direction of clearly negative variance. Instantiated for N = 3 and 6.
template <int N>
std::optional<Eigen::Matrix<double, N, N>> CovarianceFactor(
    const Eigen::Matrix<double, N, N>& covariance);

}  // namespace portolan

#endif  // PORTOLAN_COMMON_WIRE_COVARIANCE_FACTOR_H_
