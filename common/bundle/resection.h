// The pose of one camera from points whose places are known.
#ifndef PORTOLAN_COMMON_BUNDLE_RESECTION_H_
#define PORTOLAN_COMMON_BUNDLE_RESECTION_H_

#include <optional>
#include <vector>

#include "common/base/status.h"
#include "common/bundle/bundle_terms.h"

namespace portolan {

struct ResectionOptions {
  // Gauss-Newton steps at most; from a prediction two or three are enough.
  int max_iterations = 6;
  // Errors beyond this many sigmas weigh less (Cauchy); squared errors beyond the limit are
  // outliers. As in the adjustment.
  double loss_scale_sigmas = 4.0;
  double outlier_chi2 = 16.0;
  // Fewer inliers, or a smaller share of them, make no pose.
  int min_inliers = 12;
  double min_inlier_share = 0.4;

  Status Validate() const;
};

// A point with an uncertain distance, seen from where the last keyframe was: bundle_terms.h's
// parameters (0, 0, inverse_depth) about the reference.
struct DepthPoint {
  PointReference reference;
  double inverse_depth = 0;
  double inverse_depth_variance = 0;
};

struct PointSight {
  const DepthPoint* point = nullptr;  // not owned
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double sigma_px = 1.0;
};

// Squared error of a sight in sigmas, its depth's uncertainty included.
double SightChi2(const CameraState& camera, const PointSight& sight);

// Minimises the Cauchy loss of the reprojection errors, each with the variance that the point's
// inverse depth adds, from `start`. No value if too few sights fit. Deterministic.
std::optional<Rigid3> Resect(const ResectionOptions& options, const CameraModel& camera,
                             const std::vector<PointSight>& sights, const Rigid3& start);

}  // namespace portolan

#endif  // PORTOLAN_COMMON_BUNDLE_RESECTION_H_
