#include "server/refinement/bundle_adjuster.h"

#include <ceres/ceres.h>

#include <array>
#include <cmath>
#include <memory>

#include "server/refinement/bundle_costs.h"

namespace portolan {
namespace {

// One Levenberg-Marquardt solve over the present inliers.
class Round {
 public:
  Round(const BundleOptions& options, const BundleProblem& problem)
      : options_(options),
        data_(problem),
        median_depth_(MedianDepth(problem)),
        loss_(options.loss_scale_sigmas),
        ceres_(CeresOptions()) {}

  ceres::Solver::Summary Solve(const std::atomic<bool>* interrupt) {
    AddReferences();
    AddResiduals();
    return RunCeres(interrupt);
  }

  void WriteTo(BundleProblem* problem) const {
    for (size_t i = 0; i < cameras_.size(); ++i) {
      if (!cameras_used_[i] || data_.cameras[i].fixed) continue;
      problem->cameras[i].world_from_camera = camera_references_[i].Apply(cameras_[i].data());
    }
    const double min_rho = MinRho();
    for (size_t i = 0; i < points_.size(); ++i) {
      if (!PointIsAdjusted(i)) continue;
      problem->points[i].point_in_world = point_references_[i].Apply(points_[i].data(), min_rho);
    }
  }

 private:
  static ceres::Problem::Options CeresOptions() {
    ceres::Problem::Options options;
    options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    options.disable_all_safety_checks = true;
    return options;
  }

  double MinRho() const { return 1.0 / (options_.max_depth_medians * median_depth_); }

  bool PointIsAdjusted(size_t i) const { return inliers_[i] >= 2 && !data_.points[i].fixed; }

  // Anchors every point at the first camera that sees it.
  void AddReferences() {
    for (const BundleCamera& camera : data_.cameras) {
      camera_references_.push_back({camera.world_from_camera, camera.model});
    }
    cameras_.assign(data_.cameras.size(), {});
    cameras_used_.assign(data_.cameras.size(), false);
    points_.assign(data_.points.size(), {});
    point_references_.resize(data_.points.size());
    inliers_.assign(data_.points.size(), 0);
    for (const BundleObservation& observation : data_.observations) {
      if (!observation.inlier || inliers_[observation.point]++ > 0) continue;
      const Eigen::Vector3d& anchor =
          data_.cameras[observation.camera].world_from_camera.translation;
      const Eigen::Vector3d& point = data_.points[observation.point].point_in_world;
      point_references_[observation.point] = PointReference::At(anchor, point);
      points_[observation.point][2] = 1.0 / std::max((point - anchor).norm(), 1e-9);
    }
  }

  void AddResiduals() {
    for (const BundleObservation& observation : data_.observations) {
      if (!observation.inlier || inliers_[observation.point] < 2) continue;
      if (data_.cameras[observation.camera].fixed && data_.points[observation.point].fixed) {
        continue;
      }
      ceres_.AddResidualBlock(new ReprojectionCost(&camera_references_[observation.camera],
                                                   &point_references_[observation.point],
                                                   observation.pixel, observation.sigma_px),
                              &loss_, cameras_[observation.camera].data(),
                              points_[observation.point].data());
      cameras_used_[observation.camera] = true;
    }
    AddPriors();
    for (size_t i = 0; i < cameras_.size(); ++i) {
      if (cameras_used_[i] && data_.cameras[i].fixed) {
        ceres_.SetParameterBlockConstant(cameras_[i].data());
      }
    }
  }

  void AddPriors() {
    for (size_t i = 0; i < points_.size(); ++i) {
      if (inliers_[i] < 2) continue;
      if (data_.points[i].fixed) {
        if (ceres_.HasParameterBlock(points_[i].data())) {
          ceres_.SetParameterBlockConstant(points_[i].data());
        }
        continue;
      }
      const double rho = points_[i][2];
      const double sigma = std::max(options_.inverse_depth_prior_relative * rho,
                                    options_.inverse_depth_prior_of_median / median_depth_);
      ceres_.AddResidualBlock(new InverseDepthCost(rho, sigma), nullptr, points_[i].data());
    }
    for (size_t i = 0; i < cameras_.size(); ++i) {
      const BundleCamera& camera = data_.cameras[i];
      if (!cameras_used_[i] || camera.fixed || !camera.prior) continue;
      ceres_.AddResidualBlock(new PositionCost(&camera_references_[i], *camera.prior), nullptr,
                              cameras_[i].data());
    }
    for (const DistancePrior& prior : data_.distances) {
      if (!cameras_used_[prior.camera_a] || !cameras_used_[prior.camera_b]) continue;
      ceres_.AddResidualBlock(
          new DistanceCost(&camera_references_[prior.camera_a], &camera_references_[prior.camera_b],
                           prior.distance, prior.sigma_log),
          nullptr, cameras_[prior.camera_a].data(), cameras_[prior.camera_b].data());
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
    solver.num_threads = options_.num_threads;
    solver.logging_type = ceres::SILENT;
    int free_cameras = 0;
    auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    for (size_t i = 0; i < cameras_.size(); ++i) {
      if (!cameras_used_[i]) continue;
      ordering->AddElementToGroup(cameras_[i].data(), 1);
      if (!data_.cameras[i].fixed) ++free_cameras;
    }
    for (size_t i = 0; i < points_.size(); ++i) {
      if (inliers_[i] >= 2 && ceres_.HasParameterBlock(points_[i].data())) {
        ordering->AddElementToGroup(points_[i].data(), 0);
      }
    }
    solver.linear_solver_ordering = ordering;
    // Under some fifty cameras the dense factorisation wins over the sparse one's bookkeeping.
    solver.linear_solver_type = free_cameras < 50 ? ceres::DENSE_SCHUR : ceres::SPARSE_SCHUR;
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
  double median_depth_;
  std::vector<CameraReference> camera_references_;
  std::vector<std::array<double, 6>> cameras_;
  std::vector<bool> cameras_used_;
  std::vector<PointReference> point_references_;
  std::vector<std::array<double, 3>> points_;
  std::vector<int> inliers_;  // of a point
  ceres::CauchyLoss loss_;
  ceres::Problem ceres_;  // last: it refers to all of the above
};

void MarkInliers(const BundleOptions& options, BundleProblem* problem, BundleSummary* summary) {
  summary->inlier_count = 0;
  double sum_sigmas = 0;
  double sum_px = 0;
  for (BundleObservation& observation : problem->observations) {
    const double chi2 = ReprojectionChi2(*problem, observation);
    observation.inlier = chi2 < options.outlier_chi2;
    if (!observation.inlier) continue;
    ++summary->inlier_count;
    sum_sigmas += chi2;
    sum_px += chi2 * observation.sigma_px * observation.sigma_px;
  }
  if (summary->inlier_count == 0) return;
  summary->rms_sigmas = std::sqrt(sum_sigmas / summary->inlier_count);
  summary->rms_px = std::sqrt(sum_px / summary->inlier_count);
}

}  // namespace

Status BundleOptions::Validate() const {
  if (max_iterations < 1 || rounds < 1 || num_threads < 1) {
    return absl::InvalidArgumentError("bundle: iterations, rounds and threads must be positive");
  }
  if (!(loss_scale_sigmas > 0) || !(outlier_chi2 > 0) || !(function_tolerance >= 0)) {
    return absl::InvalidArgumentError("bundle: loss scale and outlier limit must be positive");
  }
  if (!(inverse_depth_prior_relative > 0) || !(inverse_depth_prior_of_median > 0) ||
      !(max_depth_medians > 1)) {
    return absl::InvalidArgumentError("bundle: the depth prior must be positive");
  }
  return absl::OkStatus();
}

BundleSummary AdjustBundle(const BundleOptions& options, const std::atomic<bool>* interrupt,
                           BundleProblem* problem) {
  BundleSummary summary;
  for (int i = 0; i < options.rounds && !summary.interrupted; ++i) {
    Round round(options, *problem);
    const ceres::Solver::Summary result = round.Solve(interrupt);
    if (!result.IsSolutionUsable() || result.num_residual_blocks == 0) break;
    if (i == 0) summary.initial_cost = result.initial_cost;
    summary.final_cost = result.final_cost;
    summary.iterations += static_cast<int>(result.iterations.size()) - 1;
    summary.usable = true;
    summary.interrupted = interrupt != nullptr && *interrupt;
    round.WriteTo(problem);
    MarkInliers(options, problem, &summary);
  }
  return summary;
}

}  // namespace portolan
