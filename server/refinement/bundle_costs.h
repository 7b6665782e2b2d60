// The residuals of common/bundle/bundle_terms.h as cost functions of Ceres.
#ifndef PORTOLAN_SERVER_REFINEMENT_BUNDLE_COSTS_H_
#define PORTOLAN_SERVER_REFINEMENT_BUNDLE_COSTS_H_

#include <ceres/sized_cost_function.h>

#include "common/bundle/bundle_terms.h"

namespace portolan {

// ReprojectionError.
class ReprojectionCost : public ceres::SizedCostFunction<2, 6, 3> {
 public:
  ReprojectionCost(const CameraReference* camera, const PointReference* point,
                   const Eigen::Vector2d& pixel, double sigma_px)
      : camera_(camera), error_(point, pixel, sigma_px) {}

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  const CameraReference* camera_;
  ReprojectionError error_;
};

// (t - position) / sigma.
class PositionCost : public ceres::SizedCostFunction<3, 6> {
 public:
  PositionCost(const CameraReference* camera, const PositionPrior& prior)
      : camera_(camera), prior_(prior) {}

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  const CameraReference* camera_;
  PositionPrior prior_;
};

// log(|t_a - t_b| / distance) / sigma_log.
class DistanceCost : public ceres::SizedCostFunction<1, 6, 6> {
 public:
  DistanceCost(const CameraReference* camera_a, const CameraReference* camera_b, double distance,
               double sigma_log)
      : camera_a_(camera_a),
        camera_b_(camera_b),
        distance_(distance),
        inverse_sigma_(1.0 / sigma_log) {}

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  const CameraReference* camera_a_;
  const CameraReference* camera_b_;
  double distance_;
  double inverse_sigma_;
};

// (rho - rho0) / sigma: keeps points whose parallax tells nothing where they are. The second
// residual is always 0: with two rows in every block of a point Ceres takes its elimination for
// fixed sizes (2, 3, 6), which is several times faster.
class InverseDepthCost : public ceres::SizedCostFunction<2, 3> {
 public:
  InverseDepthCost(double rho, double sigma) : rho_(rho), inverse_sigma_(1.0 / sigma) {}

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  double rho_;
  double inverse_sigma_;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_REFINEMENT_BUNDLE_COSTS_H_
