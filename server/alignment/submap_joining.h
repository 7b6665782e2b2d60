// Submap joining by constraint equations: every submap is one Gaussian on points of its own frame
// (landmarks, positions of shared keyframes); those that two submaps share are equal in the
// world. This is the constrained local submap filter (Williams, Dissanayake, Durrant-Whyte, 2002),
// solved for all submaps at once.
//
// Unknowns: a similarity a submap (the first one's is the identity) and the shared landmarks in the
// world; a landmark that only one submap has follows from its submap and is not needed. For two
// submaps with rigid frames the result equals the textbook projection onto the constraint,
//   x+ = x - P C' (C P C')^-1 (C x - b),   P+ = P - P C' (C P C')^-1 C P,
// with C the Jacobian of the constraints, iterated because they are not linear.
#ifndef PORTOLAN_SERVER_ALIGNMENT_SUBMAP_JOINING_H_
#define PORTOLAN_SERVER_ALIGNMENT_SUBMAP_JOINING_H_

#include <vector>

#include "common/base/status.h"
#include "common/geometry/similarity3.h"

namespace portolan {

// The marginal Gaussian of one submap on the landmarks that others share.
struct SubmapGaussian {
  std::vector<int> landmarks;                     // names, each at most once
  std::vector<Eigen::Vector3d> points_in_submap;  // means, parallel to landmarks
  Eigen::MatrixXd covariance;                     // joint, 3 rows a landmark, positive definite
  // The frame the solution starts from.
  Similarity3 world_from_submap;
  // Metric submaps only turn and move.
  bool rigid = false;
};

struct JoinedSubmaps {
  std::vector<Similarity3> world_from_submap;
  // By name; landmarks that only one submap has are left out.
  std::vector<int> landmarks;
  std::vector<Eigen::Vector3d> points_in_world;
  // Joint of the shared landmarks in the world, in the frame of the first submap.
  Eigen::MatrixXd covariance;
  // Sum of the squared Mahalanobis distances of the submaps' Gaussians; chi-square distributed
  // with `degrees_of_freedom`.
  double chi2 = 0;
  int degrees_of_freedom = 0;
  int iterations = 0;
};

struct SubmapJoiningOptions {
  int max_iterations = 30;
  double tolerance = 1e-12;  // relative decrease of chi2 that ends the iteration
};

// Gauss-Newton on the sparse normal equations. InvalidArgument if sizes do not match or a
// covariance is not positive definite; FailedPrecondition if the system is singular (a submap that
// shares too few landmarks with the others).
StatusOr<JoinedSubmaps> JoinSubmaps(const SubmapJoiningOptions& options,
                                    const std::vector<SubmapGaussian>& submaps);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_ALIGNMENT_SUBMAP_JOINING_H_
