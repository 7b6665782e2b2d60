#include "server/refinement/bundle_adjuster.h"

#include <ceres/ceres.h>

#include <array>
#include <cmath>
#include <memory>
#include <utility>

#include "common/bundle/bundle_solver.h"
#include "server/refinement/bundle_costs.h"

namespace portolan {
namespace {

class GemanMcClureLoss : public ceres::LossFunction {
 public:
  explicit GemanMcClureLoss(double scale) : square_(scale * scale) {}
  void Evaluate(double chi2, double out[3]) const override {
    const double share = square_ / (square_ + chi2);
    out[0] = chi2 * share;
    out[1] = share * share;
    out[2] = -2 * share * share * share / square_;
  }

 private:
  const double square_;
};

std::unique_ptr<ceres::LossFunction> MakeLoss(const BundleOptions& options) {
  if (options.loss == RobustLoss::kGemanMcClure) {
    return std::make_unique<GemanMcClureLoss>(options.loss_scale_sigmas);
  }
  return std::make_unique<ceres::CauchyLoss>(options.loss_scale_sigmas);
}

// For problems with many free cameras.
class CeresSolve {
 public:
  CeresSolve(const BundleOptions& options, const BundleProblem& problem,
             BundleParameters* parameters)
      : options_(options),
        data_(problem),
        parameters_(*parameters),
        loss_(MakeLoss(options)),
        ceres_(CeresOptions()) {}

  BundleSolve Run(const std::atomic<bool>* interrupt) {
    AddResiduals();
    const ceres::Solver::Summary summary = RunCeres(interrupt);
    return {summary.IsSolutionUsable() && summary.num_residual_blocks > 0, summary.initial_cost,
            summary.final_cost, static_cast<int>(summary.iterations.size()) - 1};
  }

 private:
  static ceres::Problem::Options CeresOptions() {
    ceres::Problem::Options options;
    options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    options.disable_all_safety_checks = true;
    return options;
  }

  void AddResiduals() {
    for (const BundleObservation& observation : data_.observations) {
      if (!parameters_.HasSay(data_, observation)) continue;
      ceres_.AddResidualBlock(
          new ReprojectionCost(&parameters_.camera_references[observation.camera],
                               &parameters_.point_references[observation.point], observation.pixel,
                               observation.sigma_px),
          loss_.get(), parameters_.cameras[observation.camera].data(),
          parameters_.points[observation.point].data());
    }
    AddPriors();
    for (size_t i = 0; i < parameters_.cameras.size(); ++i) {
      if (parameters_.cameras_used[i] && data_.cameras[i].fixed) {
        ceres_.SetParameterBlockConstant(parameters_.cameras[i].data());
      }
    }
  }

  void AddPriors() {
    for (size_t i = 0; i < parameters_.points.size(); ++i) {
      double* point = parameters_.points[i].data();
      if (parameters_.IsAdjusted(data_, i)) {
        ceres_.AddResidualBlock(
            new InverseDepthCost(point[2], parameters_.InverseDepthSigma(options_, i)), nullptr,
            point);
      } else if (ceres_.HasParameterBlock(point)) {
        ceres_.SetParameterBlockConstant(point);
      }
    }
    for (size_t i = 0; i < parameters_.cameras.size(); ++i) {
      const BundleCamera& camera = data_.cameras[i];
      if (!parameters_.cameras_used[i] || camera.fixed || !camera.prior) continue;
      ceres_.AddResidualBlock(new PositionCost(&parameters_.camera_references[i], *camera.prior),
                              nullptr, parameters_.cameras[i].data());
    }
    for (const DistancePrior& prior : data_.distances) {
      if (!parameters_.cameras_used[prior.camera_a] || !parameters_.cameras_used[prior.camera_b]) {
        continue;
      }
      ceres_.AddResidualBlock(new DistanceCost(&parameters_.camera_references[prior.camera_a],
                                               &parameters_.camera_references[prior.camera_b],
                                               prior.distance, prior.sigma_log),
                              nullptr, parameters_.cameras[prior.camera_a].data(),
                              parameters_.cameras[prior.camera_b].data());
    }
  }

  class InterruptCallback : public ceres::IterationCallback {
   public:
    explicit InterruptCallback(const std::atomic<bool>* interrupt) : interrupt_(interrupt) {}
    ceres::CallbackReturnType operator()(const ceres::IterationSummary&) override {
      return *interrupt_ ? ceres::SOLVER_TERMINATE_SUCCESSFULLY : ceres::SOLVER_CONTINUE;
    }

   private:
    const std::atomic<bool>* interrupt_;
  };

  ceres::Solver::Summary RunCeres(const std::atomic<bool>* interrupt) {
    ceres::Solver::Options solver;
    solver.max_num_iterations = options_.max_iterations;
    solver.function_tolerance = options_.function_tolerance;
    solver.initial_trust_region_radius = 1.0 / options_.initial_damping;
    solver.num_threads = options_.num_threads;
    solver.logging_type = ceres::SILENT;
    auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    for (size_t i = 0; i < parameters_.cameras.size(); ++i) {
      if (!parameters_.cameras_used[i]) continue;
      ordering->AddElementToGroup(parameters_.cameras[i].data(), 1);
    }
    for (std::array<double, 3>& point : parameters_.points) {
      if (ceres_.HasParameterBlock(point.data())) ordering->AddElementToGroup(point.data(), 0);
    }
    solver.linear_solver_ordering = ordering;
    solver.linear_solver_type = ceres::SPARSE_SCHUR;
    std::unique_ptr<InterruptCallback> callback;
    if (interrupt != nullptr) {
      callback = std::make_unique<InterruptCallback>(interrupt);
      solver.callbacks.push_back(callback.get());
    }
    ceres::Solver::Summary summary;
    ceres::Solve(solver, &ceres_, &summary);
    return summary;
  }

  const BundleOptions& options_;
  const BundleProblem& data_;
  BundleParameters& parameters_;
  const std::unique_ptr<ceres::LossFunction> loss_;
  ceres::Problem ceres_;  // last: it refers to all of the above
};

int FreeCameras(const BundleProblem& problem, const BundleParameters& parameters) {
  int count = 0;
  for (size_t i = 0; i < problem.cameras.size(); ++i) {
    if (parameters.cameras_used[i] && !problem.cameras[i].fixed) ++count;
  }
  return count;
}

// True if some observation changed sides.
bool MarkInliers(const BundleOptions& options, BundleProblem* problem, BundleSummary* summary) {
  bool has_changed = false;
  summary->inlier_count = 0;
  double sum_sigmas = 0;
  double sum_px = 0;
  for (BundleObservation& observation : problem->observations) {
    const double chi2 = ReprojectionChi2(*problem, observation);
    const bool was_inlier = std::exchange(observation.inlier, chi2 < options.outlier_chi2);
    has_changed = has_changed || observation.inlier != was_inlier;
    if (!observation.inlier) continue;
    ++summary->inlier_count;
    sum_sigmas += chi2;
    sum_px += chi2 * observation.sigma_px * observation.sigma_px;
  }
  if (summary->inlier_count == 0) return has_changed;
  summary->rms_sigmas = std::sqrt(sum_sigmas / summary->inlier_count);
  summary->rms_px = std::sqrt(sum_px / summary->inlier_count);
  return has_changed;
}

}  // namespace

BundleSummary AdjustBundle(const BundleOptions& options, const std::atomic<bool>* interrupt,
                           BundleProblem* problem) {
  BundleSummary summary;
  for (int i = 0; i < options.rounds && !summary.interrupted; ++i) {
    BundleParameters parameters(*problem);
    const bool is_small = FreeCameras(*problem, parameters) <= options.max_block_cameras;
    const BundleSolve solve = is_small ? SolveBundle(options, *problem, interrupt, &parameters)
                                       : CeresSolve(options, *problem, &parameters).Run(interrupt);
    if (!solve.usable) break;
    if (i == 0) summary.initial_cost = solve.initial_cost;
    summary.final_cost = solve.final_cost;
    summary.iterations += solve.iterations;
    summary.usable = true;
    summary.interrupted = interrupt != nullptr && *interrupt;
    parameters.WriteTo(options, problem);
    const bool has_changed = MarkInliers(options, problem, &summary);
    // Another round would start where this one converged.
    if (!has_changed && solve.iterations < options.max_iterations) break;
  }
  return summary;
}

}  // namespace portolan
