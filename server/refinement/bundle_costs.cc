#include "server/refinement/bundle_costs.h"

#include <algorithm>

namespace portolan {

bool ReprojectionCost::Evaluate(double const* const* parameters, double* residuals,
                                double** jacobians) const {
  error_.Evaluate(CameraState(*camera_, parameters[0]), parameters[1], residuals,
                  jacobians == nullptr ? nullptr : jacobians[0],
                  jacobians == nullptr ? nullptr : jacobians[1]);
  return true;
}

bool PositionCost::Evaluate(double const* const* parameters, double* residuals,
                            double** jacobians) const {
  EvaluatePositionPrior(*camera_, prior_, parameters[0], residuals,
                        jacobians == nullptr ? nullptr : jacobians[0]);
  return true;
}

bool DistanceCost::Evaluate(double const* const* parameters, double* residuals,
                            double** jacobians) const {
  EvaluateDistancePrior(*camera_a_, *camera_b_, distance_, inverse_sigma_, parameters[0],
                        parameters[1], residuals, jacobians == nullptr ? nullptr : jacobians[0],
                        jacobians == nullptr ? nullptr : jacobians[1]);
  return true;
}

bool InverseDepthCost::Evaluate(double const* const* parameters, double* residuals,
                                double** jacobians) const {
  residuals[0] = (parameters[0][2] - rho_) * inverse_sigma_;
  residuals[1] = 0;
  if (jacobians != nullptr && jacobians[0] != nullptr) {
    std::fill_n(jacobians[0], 6, 0.0);
    jacobians[0][2] = inverse_sigma_;
  }
  return true;
}

}  // namespace portolan
