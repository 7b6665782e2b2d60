// Measurements of landmarks in an image, as they go into and come out of the filter.
#ifndef PORTOLAN_AGENT_FILTER_MEASUREMENT_H_
#define PORTOLAN_AGENT_FILTER_MEASUREMENT_H_

#include <Eigen/Core>
#include <vector>

#include "common/base/strong_id.h"

namespace portolan {

// A match: raw (distorted) pixel and its isotropic sigma.
struct Measurement {
  TrackId track;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double sigma_px = 1.0;
};

// What is known of a new landmark's depth by other means than its prior: 1 / distance from the
// current camera along the measured pixel, in 1/unit, and the sigma of that measurement alone; that
// its unit of length is the state's is the filter's to add.
struct MeasuredDepth {
  TrackId track;
  double inverse_depth = 0;
  double sigma = 0;
  // A sensor's own length, in metres, that owes nothing to the state; the filter's lengths are
  // metric (LocalFilter::TakeMetricDepths).
  bool is_metric = false;
};

// Where a landmark will be seen. The covariance includes a measurement noise of one pixel; the
// search region of a match is its ellipse.
struct PredictedMeasurement {
  TrackId track;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  Eigen::Matrix2d innovation_covariance = Eigen::Matrix2d::Identity();
};

struct UpdateResult {
  std::vector<TrackId> inliers;
  std::vector<TrackId> outliers;
  // Normalised innovation squared of the inliers over its degrees of freedom; 1 is expected.
  double normalised_innovation = 0;
  int ransac_hypotheses = 0;
  // The motion prediction was found at fault and its noise was raised.
  bool manoeuvre = false;
  // Landmarks that the filter itself gave up in this update (impossible depth).
  std::vector<TrackId> dropped;
};

struct LandmarkEstimate {
  TrackId track;
  // For a ray: anchor + ray / inverse_depth, meaningless unless the depth is known.
  Eigen::Vector3d point_in_submap = Eigen::Vector3d::Zero();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Identity();
  // From the anchor for a ray, from the current camera for a Euclidean landmark; 1/unit.
  double inverse_depth = 0;
  double inverse_depth_sigma = 0;
  bool euclidean = false;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_FILTER_MEASUREMENT_H_
