#include "server/alignment/map_adjuster.h"

#include <algorithm>
#include <cmath>
#include <initializer_list>

#include "server/alignment/window_problem.h"

namespace portolan {
namespace {

class WindowAdjustment {
 public:
  WindowAdjustment(const MapAdjusterOptions& options, const std::vector<SubmapId>& window,
                   MapModel* model, const PositionReferences* positions)
      : options_(options),
        window_(options, window, model, positions),
        problem_(window_.problem()),
        result_(window_.contents()) {}

  MapAdjustment Run(int passes, const std::atomic<bool>* interrupt) {
    BundleOptions bundle = options_.bundle;
    for (int pass = 0; pass < passes; ++pass) {
      if (pass > 0) {
        if (interrupt != nullptr && *interrupt) break;
        window_.Retriangulate();
        bundle.rounds = 1;
      }
      if (!Adjust(bundle, interrupt)) break;
    }
    return Finish();
  }

  MapAdjustment Settle(const std::atomic<bool>* interrupt) {
    if (result_.cameras > options_.max_cameras_anew) {
      SettleLarge(interrupt);
      return Finish();
    }
    if (!Converge(interrupt)) return Finish();
    // A narrow loss keeps to the minimum at hand and judges its outliers anew. What a wide one
    // finds depends least on the start, and is preferred as long as it fits about as well.
    if (TryAnew({1.0}, 0.0, interrupt))
      TryAnew({2.0, 1.0}, options_.settling_preference, interrupt);
    return Finish();
  }

 private:
  // What an adjustment changes of its problem.
  struct Estimate {
    std::vector<BundleCamera> cameras;
    std::vector<BundlePoint> points;
    std::vector<BundleLens> lenses;
    std::vector<bool> inliers;
  };

  Estimate CurrentEstimate() const {
    Estimate estimate{problem_.cameras, problem_.points, problem_.lenses, {}};
    for (const BundleObservation& observation : problem_.observations) {
      estimate.inliers.push_back(observation.inlier);
    }
    return estimate;
  }

  void SetEstimate(const Estimate& estimate) {
    problem_.cameras = estimate.cameras;
    problem_.points = estimate.points;
    problem_.lenses = estimate.lenses;
    for (size_t i = 0; i < problem_.observations.size(); ++i) {
      problem_.observations[i].inlier = estimate.inliers[i];
    }
  }

  // False: nothing was gained, or it was interrupted.
  bool Adjust(const BundleOptions& bundle, const std::atomic<bool>* interrupt) {
    const BundleSummary summary = AdjustBundle(bundle, interrupt, &problem_);
    if (summary.usable) {
      result_.summary = summary;
    } else {
      result_.summary.interrupted = interrupt != nullptr && *interrupt;
    }
    return summary.usable && !summary.interrupted;
  }

  BundleOptions SettlingOptions() const {
    BundleOptions bundle = options_.bundle;
    bundle.function_tolerance = options_.settling_tolerance;
    bundle.rounds = options_.settling_rounds;
    return bundle;
  }

  // Until the inliers stay.
  bool Converge(const std::atomic<bool>* interrupt) {
    const BundleOptions bundle = SettlingOptions();
    if (!Adjust(bundle, interrupt)) return false;
    window_.Retriangulate();
    return Adjust(bundle, interrupt);
  }

  // Its outliers depend on where the cameras are, no longer on which they were.
  void SettleLarge(const std::atomic<bool>* interrupt) {
    BundleOptions bundle = SettlingOptions();
    bundle.initial_damping = options_.settling_damping;
    bundle.inverse_depth_prior_relative *= options_.settling_depth_prior;
    bundle.inverse_depth_prior_of_median *= options_.settling_depth_prior;
    bundle.rounds = 1;
    if (!Adjust(bundle, interrupt)) return;
    window_.TriangulateAnew();
    bundle.rounds = options_.settling_rounds;
    Adjust(bundle, interrupt);
  }

  // Converges anew from each of these widths; goes back if the cost is more than before by a larger
  // share than `preference`. False: interrupted.
  bool TryAnew(std::initializer_list<double> widths, double preference,
               const std::atomic<bool>* interrupt) {
    const Estimate before = CurrentEstimate();
    const BundleSummary summary = result_.summary;
    const bool is_done = std::all_of(widths.begin(), widths.end(), [&](double width) {
      return AdjustAnew(width, interrupt) && Converge(interrupt);
    });
    if (is_done &&
        CostWithOutliers(result_.summary) <= (1 + preference) * CostWithOutliers(summary)) {
      return true;
    }
    SetEstimate(before);
    const bool is_interrupted = result_.summary.interrupted;
    result_.summary = summary;
    result_.summary.interrupted = is_interrupted;
    return !is_interrupted;
  }

  // Graduated non-convexity (Yang, Antonante, Tzoumas, Carlone 2020) from a loss of this width,
  // relative to that of an adjustment, with every observation an inlier: what was an outlier before
  // has no influence.
  bool AdjustAnew(double width, const std::atomic<bool>* interrupt) {
    BundleOptions bundle = options_.bundle;
    bundle.loss = RobustLoss::kGemanMcClure;
    bundle.rounds = 1;
    for (; width >= 1; width /= 2) {
      bundle.loss_scale_sigmas = width * options_.bundle.loss_scale_sigmas;
      for (BundleObservation& observation : problem_.observations) observation.inlier = true;
      if (!Adjust(bundle, interrupt)) return false;
    }
    return true;
  }

  // With what outliers would cost at the limit up to which they are inliers.
  double CostWithOutliers(const BundleSummary& summary) const {
    const double square = options_.bundle.loss_scale_sigmas * options_.bundle.loss_scale_sigmas;
    const double at_limit = 0.5 * square * std::log1p(options_.bundle.outlier_chi2 / square);
    const auto outliers = static_cast<double>(problem_.observations.size()) - summary.inlier_count;
    return summary.final_cost + at_limit * outliers;
  }

  MapAdjustment Finish() {
    if (result_.summary.usable) window_.WriteBack();
    return result_;
  }

  const MapAdjusterOptions& options_;
  WindowProblem window_;
  BundleProblem& problem_;
  MapAdjustment result_;
};

}  // namespace

Status MapAdjusterOptions::Validate() const {
  PORTOLAN_RETURN_IF_ERROR(bundle.Validate());
  PORTOLAN_RETURN_IF_ERROR(triangulation.Validate());
  PORTOLAN_RETURN_IF_ERROR(metric.Validate());
  PORTOLAN_RETURN_IF_ERROR(positions.Validate());
  if (settling_rounds < 1 || !(settling_tolerance >= 0) || !(settling_preference >= 0) ||
      max_cameras_anew < 0 || !(settling_damping > 0) || !(settling_depth_prior >= 1)) {
    return absl::InvalidArgumentError("map adjuster: settling options out of range");
  }
  if (!(min_metric_path_of_depth >= 0) || !(control_point_chi2 > 0) || min_lens_keyframes < 0 ||
      !(lens_corner_sigma_px > 0)) {
    return absl::InvalidArgumentError("map adjuster: limits out of range");
  }
  return absl::OkStatus();
}

MapAdjustment AdjustMap(const MapAdjusterOptions& options, const std::vector<SubmapId>& window,
                        int passes, const std::atomic<bool>* interrupt, MapModel* model,
                        const PositionReferences* positions) {
  return WindowAdjustment(options, window, model, positions).Run(passes, interrupt);
}

MapAdjustment SettleMap(const MapAdjusterOptions& options, const std::vector<SubmapId>& window,
                        const std::atomic<bool>* interrupt, MapModel* model,
                        const PositionReferences* positions) {
  return WindowAdjustment(options, window, model, positions).Settle(interrupt);
}

}  // namespace portolan
