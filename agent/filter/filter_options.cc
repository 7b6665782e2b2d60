#include "agent/filter/filter_options.h"

namespace portolan {
namespace {

Status Require(bool condition, const char* message) {
  return condition ? absl::OkStatus() : absl::InvalidArgumentError(message);
}

}  // namespace

Status FilterOptions::Validate() const {
  PORTOLAN_RETURN_IF_ERROR(
      Require(max_landmarks >= 4 && max_landmarks <= 1000, "max_landmarks must be 4..1000"));
  PORTOLAN_RETURN_IF_ERROR(Require(first_inverse_depth > 0, "first_inverse_depth must be > 0"));
  PORTOLAN_RETURN_IF_ERROR(
      Require(inverse_depth_sigma_ratio > 0, "inverse_depth_sigma_ratio must be > 0"));
  PORTOLAN_RETURN_IF_ERROR(Require(linearity_threshold >= 0, "linearity_threshold must be >= 0"));
  PORTOLAN_RETURN_IF_ERROR(Require(negative_depth_sigmas > 0, "negative_depth_sigmas must be > 0"));
  PORTOLAN_RETURN_IF_ERROR(
      Require(prior_gate_chi2 > 0 && low_innovation_chi2 > 0 && rescue_chi2 > 0,
              "chi-square gates must be > 0"));
  PORTOLAN_RETURN_IF_ERROR(Require(ransac_success_probability > 0 && ransac_success_probability < 1,
                                   "ransac_success_probability must be inside (0, 1)"));
  PORTOLAN_RETURN_IF_ERROR(
      Require(ransac_max_hypotheses >= 1, "ransac_max_hypotheses must be >= 1"));
  PORTOLAN_RETURN_IF_ERROR(Require(joint_probability > 0.5 && joint_probability < 1,
                                   "joint_probability must be inside (0.5, 1)"));
  PORTOLAN_RETURN_IF_ERROR(Require(joint_max_nodes >= 1, "joint_max_nodes must be >= 1"));
  PORTOLAN_RETURN_IF_ERROR(Require(manoeuvre_gate_share >= 0 && manoeuvre_gate_share <= 1,
                                   "manoeuvre_gate_share must be 0..1"));
  PORTOLAN_RETURN_IF_ERROR(
      Require(manoeuvre_noise_factor >= 1, "manoeuvre_noise_factor must be >= 1"));
  PORTOLAN_RETURN_IF_ERROR(
      Require(divergence_window_frames >= 1, "divergence_window_frames must be >= 1"));
  PORTOLAN_RETURN_IF_ERROR(Require(divergence_max_normalised_innovation > 1,
                                   "divergence_max_normalised_innovation must be > 1"));
  PORTOLAN_RETURN_IF_ERROR(
      Require(divergence_min_inlier_ratio >= 0 && divergence_min_inlier_ratio <= 1,
              "divergence_min_inlier_ratio must be 0..1"));
  return start.Validate();
}

}  // namespace portolan
