// Non-linear refinement of a_from_b on the reprojection errors of matched points in both
// directions.
#ifndef PORTOLAN_SERVER_VERIFICATION_SIMILARITY_REFINEMENT_H_
#define PORTOLAN_SERVER_VERIFICATION_SIMILARITY_REFINEMENT_H_

#include <optional>
#include <vector>

#include "common/geometry/similarity3.h"
#include "server/verification/descriptor_matcher.h"
#include "server/verification/submap_points.h"

namespace portolan {

struct SimilarityRefinementOptions {
  // Standard deviation of a feature, pixels of its scale.
  double sigma_px = 1.5;
  // Sights used of a point a direction, spread over its keyframes.
  int max_views = 3;
  int max_iterations = 10;
  // Cauchy kernel's width in standard deviations.
  double robust_width = 2.0;
  // Scale stays 1.
  bool fixed_scale = false;
};

struct RefinedSimilarity {
  Similarity3 a_from_b;
  // Of the right perturbation; of full rank only if the matches determine all of it.
  Matrix7d information = Matrix7d::Zero();
  // Squared Mahalanobis distance of each match, mean over its sights; infinite if it cannot be
  // projected.
  std::vector<double> chi_squared;
  // Root mean square reprojection error of each match, pixels.
  std::vector<double> error_px;
};

// Pixel error of a's landmark in b's camera, and its Jacobian with respect to the right
// perturbation of a_from_b. No value if the point does not project.
struct LandmarkProjection {
  Eigen::Vector2d pixel;
  Eigen::Matrix<double, 2, 7> d_pixel_d_a_from_b;
  Matrix23d d_pixel_d_landmark;
};
std::optional<LandmarkProjection> ProjectFromA(const Similarity3& a_from_b,
                                               const Eigen::Vector3d& landmark_in_a,
                                               const Rigid3& camera_from_b,
                                               const CameraModel& camera_b);
// b's landmark in a's camera.
std::optional<LandmarkProjection> ProjectFromB(const Similarity3& a_from_b,
                                               const Eigen::Vector3d& landmark_in_b,
                                               const Rigid3& camera_from_a,
                                               const CameraModel& camera_a);

// Levenberg-Marquardt. Each error is weighed by the inverse of pixel noise plus projected landmark
// covariance, so that a point with poor depth pulls across its epipolar line only; all errors of
// one match together weigh as much as one, because they share the landmark and are not
// independent. No value if fewer than 3 matches project or the steps diverge.
std::optional<RefinedSimilarity> RefineSimilarity(const SubmapPoints& a, const SubmapPoints& b,
                                                  const std::vector<PointMatch>& matches,
                                                  const Similarity3& initial_a_from_b,
                                                  const SimilarityRefinementOptions& options);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_VERIFICATION_SIMILARITY_REFINEMENT_H_
