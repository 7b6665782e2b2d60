#include "common/wire/covariance_factor.h"

#include <cmath>

namespace portolan {

template <int N>
std::optional<Eigen::Matrix<double, N, N>> CovarianceFactor(
    const Eigen::Matrix<double, N, N>& covariance) {
  if (!covariance.allFinite()) return std::nullopt;
  Eigen::Matrix<double, N, N> factor = Eigen::Matrix<double, N, N>::Zero();
  for (int j = 0; j < N; ++j) {
    const double variance = covariance(j, j);
    const double rest = variance - factor.row(j).head(j).squaredNorm();
    if (variance < 0 || rest < -1e-9 * variance) return std::nullopt;
    if (rest <= 1e-14 * variance) continue;  // no variance beyond that of the earlier directions
    factor(j, j) = std::sqrt(rest);
    for (int i = j + 1; i < N; ++i) {
      factor(i, j) =
          (covariance(i, j) - factor.row(i).head(j).dot(factor.row(j).head(j))) / factor(j, j);
    }
  }
  // Catches asymmetry, and correlations with directions that have no variance.
  const Eigen::Matrix<double, N, N> error = factor * factor.transpose() - covariance;
  for (int i = 0; i < N; ++i) {
    for (int j = 0; j < N; ++j) {
      const double scale = std::sqrt(covariance(i, i)) * std::sqrt(covariance(j, j));
      if (!(std::abs(error(i, j)) <= 1e-6 * scale)) return std::nullopt;
    }
  }
  return factor;
}

template std::optional<Eigen::Matrix3d> CovarianceFactor<3>(const Eigen::Matrix3d&);
template std::optional<Matrix6d> CovarianceFactor<6>(const Matrix6d&);

}  // namespace portolan
