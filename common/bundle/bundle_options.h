// What all bundle adjustments have in common, the server's and the agent's.
#ifndef PORTOLAN_COMMON_BUNDLE_BUNDLE_OPTIONS_H_
#define PORTOLAN_COMMON_BUNDLE_BUNDLE_OPTIONS_H_

#include "common/base/status.h"

namespace portolan {

// Of an error of r sigmas, with s the scale. Cauchy: s^2 log(1 + r^2 / s^2) / 2; a far outlier
// still pulls a little. Geman-McClure: r^2 / (1 + r^2 / s^2) / 2; it does not, but what is found
// depends on the start.
enum class RobustLoss { kCauchy, kGemanMcClure };

// The agent solves once, by bundle_solver.h alone: rounds, num_threads and max_block_cameras say
// nothing there.
struct BundleOptions {
  // Levenberg-Marquardt iterations a round; convergence is usually reached well before.
  int max_iterations = 25;
  // Relative decrease of the cost under which a round ends. The ATE no longer changes below it.
  double function_tolerance = 1e-5;
  // Levenberg-Marquardt damping a round begins with, relative to the diagonal. Damping holds back
  // the bends that cost least; what is near its minimum needs none.
  double initial_damping = 1e-4;
  // Rounds of solve and outlier test; the last one is always followed by the test.
  int rounds = 2;
  // Residuals beyond this many sigmas weigh less, and an observation whose squared error in sigmas
  // exceeds the limit is an outlier. Both are wider than white noise would need (95 % of
  // chi-square with 2 degrees of freedom is 5.99): a rolling shutter and an inexact calibration
  // leave errors that still hold the map together. Keyframe ATE in mm on 7-Scenes redkitchen, three
  // agents / one agent, by (loss, limit): (2, 6) 12.9 / 10.5, (2, 9) 11.2 / 10.4, (2, 16) 10.8,
  // (4, 16) 9.8 / 9.2, (4, 25) 10.2 / 9.0.
  double loss_scale_sigmas = 4.0;
  RobustLoss loss = RobustLoss::kCauchy;
  double outlier_chi2 = 16.0;
  // The depth prior: sigma of the inverse depth relative to its value and to that of the median
  // depth. Two orders of magnitude weaker than the pixels of a point with one degree of parallax.
  double inverse_depth_prior_relative = 0.5;
  double inverse_depth_prior_of_median = 0.2;
  // Points farther than this many median depths are held at this distance.
  double max_depth_medians = 1000.0;
  // Of Ceres; bundle_solver.h takes one.
  int num_threads = 1;
  // Up to so many free cameras bundle_solver.h solves the problem, a larger one Ceres, which has no
  // table of all pairs of cameras (256 MB for these), but takes three times as long.
  int max_block_cameras = 8000;
  // Up to so many, the cameras' system is dense.
  int max_dense_cameras = 60;

  Status Validate() const;
};

}  // namespace portolan

#endif  // PORTOLAN_COMMON_BUNDLE_BUNDLE_OPTIONS_H_
