// Minimal solvers: the pose of a camera from three points, and the similarity of two triangles.
#ifndef PORTOLAN_SERVER_VERIFICATION_THREE_POINT_POSE_H_
#define PORTOLAN_SERVER_VERIFICATION_THREE_POINT_POSE_H_

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "common/geometry/similarity3.h"

namespace portolan {

// Columns are points (any unit) or unit bearings.
using ThreePoints = Eigen::Matrix3d;

// Poses (up to four) of a camera that sees the three points along the three unit bearings;
// bearings need not lie in front of an image plane, so any lens will do. Grunert's equations
// (1841) as in Haralick, Lee, Ottenberg, Noelle, IJCV 1994, Sec. 3.1, the depths polished by
// Newton steps. Empty for collinear points or where no real solution exists.
std::vector<Rigid3> SolveThreePointPose(const ThreePoints& points_in_world,
                                        const ThreePoints& bearings_in_camera);

// The similarity (scale 1 if fixed_scale) that maps the three points of b to those of a best in
// the least-squares sense (Umeyama, PAMI 1991); no value for (nearly) collinear points.
std::optional<Similarity3> AlignThreePoints(const ThreePoints& points_in_a,
                                            const ThreePoints& points_in_b, bool fixed_scale);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_VERIFICATION_THREE_POINT_POSE_H_
