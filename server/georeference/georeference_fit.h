// The similarity that takes a component's world to the site frame, from points known in both.
#ifndef PORTOLAN_SERVER_GEOREFERENCE_GEOREFERENCE_FIT_H_
#define PORTOLAN_SERVER_GEOREFERENCE_GEOREFERENCE_FIT_H_

#include <span>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/geometry/similarity3.h"
#include "common/trajectory/alignment.h"

namespace portolan {

struct GeoreferenceFitOptions {
  // Errors beyond this many sigmas lose weight (Cauchy). In a map that drifted the limit starts at
  // the errors that there are: three times their median.
  double outlier_sigmas = 3.0;
  // A turn or a scale (log) that the references' accuracy leaves more uncertain than this is not
  // determined.
  double max_rotation_sigma_rad = 0.03;
  double max_log_scale_sigma = 0.03;
  // Points whose extent across their longest direction is less than this share of the extent
  // along it lie on a line: the turn about it would come from the map's own errors.
  double min_extent_ratio = 0.05;

  Status Validate() const;
};

struct SitePoint {
  Eigen::Vector3d in_world = Eigen::Vector3d::Zero();
  Eigen::Vector3d in_site = Eigen::Vector3d::Zero();
  Eigen::Matrix3d world_covariance = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d site_covariance = Eigen::Matrix3d::Identity();  // positive definite
  // Of its information, that is its own; the rest it shares with others whose errors are the same.
  double share = 1;
};

struct GeoreferenceFit {
  // Not empty: there is no fit, for this reason; then nothing else is set.
  std::string problem;
  Similarity3 site_from_world;
  AlignmentMode mode = AlignmentMode::kSim3;
};

// Errors in_site - (site_from_world * in_world) squared, in sigmas; 3 degrees of freedom.
std::vector<double> SiteChi2(std::span<const SitePoint> points, const Similarity3& site_from_world);

// The squared scale of a Cauchy loss for these squared errors in sigmas, by the options.
double SiteLossSquare(const GeoreferenceFitOptions& options, const std::vector<double>& chi2);
// The weights by that loss.
std::vector<double> SiteWeights(const GeoreferenceFitOptions& options,
                                const std::vector<double>& chi2);

// Robust: best of many samples of three, then weighted least squares. A similarity if the points
// determine it; else a rigid motion if the world is metric; else yaw and translation if its z axis
// is vertical, too. Deterministic.
GeoreferenceFit FitGeoreference(const GeoreferenceFitOptions& options,
                                std::span<const SitePoint> points, bool is_metric,
                                bool is_vertical);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_GEOREFERENCE_GEOREFERENCE_FIT_H_
