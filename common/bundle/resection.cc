#include "common/bundle/resection.h"

#include <array>
#include <cmath>

#include "common/linear_algebra/dense.h"

namespace portolan {
namespace {

// A step below this [rad, and shares of the median distance] ends the iteration: a hundredth of a
// pixel.
constexpr double kMinStep = 2e-5;

// One sight's error at a pose.
struct SightError {
  Eigen::Vector2d residual;
  Eigen::Matrix<double, 2, 6, Eigen::RowMajor> d_camera;
  // The inverse of its covariance: along the image of the ray the depth's error adds to the
  // pixel's, (I + v d d')^-1.
  Eigen::Matrix2d weight;

  SightError(const CameraState& state, const PointSight& sight) {
    const ReprojectionError error(&sight.point->reference, sight.pixel, sight.sigma_px);
    const std::array<double, 3> parameters = {0, 0, sight.point->inverse_depth};
    Eigen::Matrix<double, 2, 3, Eigen::RowMajor> d_point;
    error.Evaluate(state, parameters.data(), residual.data(), d_camera.data(), d_point.data());
    const Eigen::Vector2d d_depth = d_point.col(2);
    const double variance = sight.point->inverse_depth_variance;
    weight = Eigen::Matrix2d::Identity() -
             (variance / (1 + variance * d_depth.squaredNorm())) * d_depth * d_depth.transpose();
  }
  double Chi2() const { return residual.dot(weight * residual); }
};

struct NormalEquations {
  Matrix6d information = Matrix6d::Zero();
  Vector6d gradient = Vector6d::Zero();
  double mean_inverse_depth = 0;
  int inliers = 0;
};

NormalEquations Linearize(const ResectionOptions& options, const CameraReference& camera,
                          const std::vector<PointSight>& sights) {
  const CameraState state(camera);
  const double square = options.loss_scale_sigmas * options.loss_scale_sigmas;
  NormalEquations equations;
  for (const PointSight& sight : sights) {
    const SightError error(state, sight);
    const double chi2 = error.Chi2();
    const double robust = 1 / (1 + chi2 / square);
    const Eigen::Matrix<double, 6, 2> weighted = robust * error.d_camera.transpose() * error.weight;
    equations.information.noalias() += weighted * error.d_camera;
    equations.gradient.noalias() += weighted * error.residual;
    equations.mean_inverse_depth += sight.point->inverse_depth / static_cast<double>(sights.size());
    if (chi2 < options.outlier_chi2) ++equations.inliers;
  }
  return equations;
}

}  // namespace

double SightChi2(const CameraState& camera, const PointSight& sight) {
  return SightError(camera, sight).Chi2();
}

Status ResectionOptions::Validate() const {
  if (max_iterations < 1 || !(loss_scale_sigmas > 0) || !(outlier_chi2 > 0) || min_inliers < 4 ||
      !(min_inlier_share >= 0 && min_inlier_share <= 1)) {
    return absl::InvalidArgumentError("resection: a limit is out of range");
  }
  return absl::OkStatus();
}

std::optional<Rigid3> Resect(const ResectionOptions& options, const CameraModel& camera,
                             const std::vector<PointSight>& sights, const Rigid3& start) {
  if (static_cast<int>(sights.size()) < options.min_inliers) return std::nullopt;
  CameraReference reference{start, &camera};
  NormalEquations equations = Linearize(options, reference, sights);
  for (int i = 0; i < options.max_iterations; ++i) {
    Vector6d step = -equations.gradient;
    if (!SolvePositiveDefinite(equations.information, step)) return std::nullopt;
    if (!step.allFinite()) return std::nullopt;
    reference.world_from_camera = reference.Apply(step.data());
    equations = Linearize(options, reference, sights);
    if (step.head<3>().norm() * equations.mean_inverse_depth < kMinStep &&
        step.tail<3>().norm() < kMinStep) {
      break;
    }
  }
  const double share = static_cast<double>(equations.inliers) / static_cast<double>(sights.size());
  if (equations.inliers < options.min_inliers || share < options.min_inlier_share) {
    return std::nullopt;
  }
  return reference.world_from_camera;
}

}  // namespace portolan
