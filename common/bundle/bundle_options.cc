#include "common/bundle/bundle_options.h"

namespace portolan {

Status BundleOptions::Validate() const {
  if (max_iterations < 1 || rounds < 1 || num_threads < 1 || max_block_cameras < 0 ||
      max_dense_cameras < 0) {
    return absl::InvalidArgumentError(
        "bundle: iterations, rounds and threads must be positive, numbers of cameras not negative");
  }
  if (!(loss_scale_sigmas > 0) || !(outlier_chi2 > 0) || !(function_tolerance >= 0) ||
      !(initial_damping > 0)) {
    return absl::InvalidArgumentError(
        "bundle: loss scale, outlier limit, tolerance and damping must be positive");
  }
  if (!(inverse_depth_prior_relative > 0) || !(inverse_depth_prior_of_median > 0) ||
      !(max_depth_medians > 1)) {
    return absl::InvalidArgumentError("bundle: the depth prior must be positive");
  }
  return absl::OkStatus();
}

}  // namespace portolan
