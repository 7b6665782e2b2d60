// Options of the local filter.
#ifndef PORTOLAN_AGENT_FILTER_FILTER_OPTIONS_H_
#define PORTOLAN_AGENT_FILTER_FILTER_OPTIONS_H_

#include <cstdint>

#include "agent/filter/kalman_update.h"
#include "agent/filter/start_smoother.h"
#include "common/base/status.h"

namespace portolan {

// How the matches of a frame are sorted into inliers and outliers.
enum class InlierSelection {
  kOnePointRansac,      // Civera, Grasa, Davison, Montiel, JFR 2010
  kChiSquareOnly,       // each match against its own ellipse
  kJointCompatibility,  // JCBB: Neira & Tardos, T-RA 2001
};

// When the covariances of landmarks out of view are updated.
enum class CovarianceUpdate {
  kFull,        // in every frame
  kCompressed,  // when they are needed: Guivant & Nebot, T-RA 2001. Equal but for rounding.
};

// Lengths are submap units; with a monocular camera one unit is about the distance of the first
// landmarks.
struct FilterOptions {
  // Most landmarks in the state; bounds the cost of a frame. The classic minimum is 14.
  int max_landmarks = 60;

  // Inverse depth of the first landmarks, in 1/unit, which fixes the unit of a monocular map.
  double first_inverse_depth = 1.0;
  // Sigma of the first inverse depths over their mean; 0.5 puts infinity at two sigma (Civera
  // 2008).
  double inverse_depth_sigma_ratio = 0.5;
  // The same once landmarks of known depth are in the state: a new one takes their mean inverse
  // depth, error included, so that its prior says nothing about the scale. A prior that is
  // independent of the state would be one more measurement of the scale with every landmark, and
  // wrong in the same sense each time.
  double relative_inverse_depth_sigma_ratio = 1.2;
  // Landmarks with less than this relative error of the inverse depth count as known.
  double known_depth_sigma_ratio = 0.25;
  int min_known_depths = 5;
  // A landmark becomes Euclidean when 4 sigma_d / d |cos alpha| falls below this (Civera 2008,
  // Eq. 34 and Sec. VI: 0.1). Half of that drifts less in scale.
  double linearity_threshold = 0.05;
  // A landmark whose inverse depth is negative by more than this many sigmas is dropped; less is
  // taken for a point at infinity.
  double negative_depth_sigmas = 3.0;

  // With at most 60 landmarks, 50 of them in view, there is little to put off.
  CovarianceUpdate covariance_update = CovarianceUpdate::kFull;

  InlierSelection inlier_selection = InlierSelection::kOnePointRansac;
  // Only matches inside this chi-square(2) region of their prediction (99.99 %; the search of the
  // tracker is narrower) may make or support a hypothesis; the others can only be rescued.
  double prior_gate_chi2 = 18.42;
  // Support of a hypothesis: squared residual in the covariance that is left given the hypothesis
  // (99 % of chi-square(2)).
  double low_innovation_chi2 = 9.21;
  // A hypothesis takes up to five matches until the variance that it leaves to the median match
  // is below this many times the pixel noise.
  double ransac_conditional_variance = 9.0;
  // Rescue after the low-innovation update, 99 % of chi-square(2).
  double rescue_chi2 = 9.21;
  // Chance that at least one hypothesis is drawn from an inlier.
  double ransac_success_probability = 0.99;
  int ransac_max_hypotheses = 30;
  uint64_t ransac_seed = 1;
  // kJointCompatibility: share of the sets of right matches that pass the joint chi-square test.
  double joint_probability = 0.99;
  // The same: pairings that are tried a frame at most. The best matches come first, so that the
  // first descent (one a match) is nearly the answer; a few hundred refine it within a millisecond.
  int joint_max_nodes = 300;
  // If fewer than this share of the matches is inside the prior gate the motion prediction is at
  // fault, not the matches: its process noise is raised by manoeuvre_noise_factor, once.
  double manoeuvre_gate_share = 0.5;
  double manoeuvre_noise_factor = 4.0;

  // While the unknown depths times the uncertain motion spread the matches by more than this many
  // times the pixel noise (variance, median of the matches), the update is searched from several
  // starts instead: the first frames of a fast camera.
  double explore_variance = 9.0;
  StartSmootherOptions start;
  KalmanUpdateOptions kalman;
  // Error of the camera model (calibration, rolling shutter) that every match has on top of its
  // own sigma.
  double model_sigma_px = 1.0;

  // Divergence is declared over a window of frames: mean normalised innovation squared per degree
  // of freedom of the inliers above the limit (1 is expected), or share of inliers among the
  // matches below the limit, or fewer inliers than the minimum in every frame.
  int divergence_window_frames = 10;
  double divergence_max_normalised_innovation = 4.0;
  double divergence_min_inlier_ratio = 0.35;
  int divergence_min_inliers = 6;

  Status Validate() const;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_FILTER_FILTER_OPTIONS_H_
