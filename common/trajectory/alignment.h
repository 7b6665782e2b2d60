// Least-squares alignment of two point patterns (Umeyama, "Least-squares estimation of
// transformation parameters between two point patterns", PAMI 1991, Eq. 34-43).
#ifndef PORTOLAN_COMMON_TRAJECTORY_ALIGNMENT_H_
#define PORTOLAN_COMMON_TRAJECTORY_ALIGNMENT_H_

#include <optional>
#include <span>
#include <string>

#include "common/base/status.h"
#include "common/geometry/similarity3.h"

namespace portolan {

// What an estimate may be moved by before its errors are taken.
enum class AlignmentMode {
  kNone,  // nothing: the estimate is in the reference's frame
  kYaw,   // rotation about the z axis and translation: metric, gravity known
  kSe3,   // rotation and translation: metric
  kSim3,  // rotation, translation and scale: monocular
};

// "none", "yaw", "se3", "sim3".
StatusOr<AlignmentMode> ParseAlignmentMode(const std::string& text);
const char* AlignmentModeName(AlignmentMode mode);

// The transform of the mode that minimises sum |reference_i - T * estimate_i|^2. Where points on
// a line leave a rotation free, one of the minimisers. No value for fewer than 3 points (kYaw: 2),
// sizes that differ, or (kSim3) estimates that all coincide, which have no scale.
std::optional<Similarity3> AlignPoints(std::span<const Eigen::Vector3d> estimate,
                                       std::span<const Eigen::Vector3d> reference,
                                       AlignmentMode mode);

// Umeyama's solution in any dimension: scale, proper rotation, translation. Columns are points.
template <int dimension>
struct SimilarityTransform {
  double scale = 1.0;
  Eigen::Matrix<double, dimension, dimension> rotation;
  Eigen::Matrix<double, dimension, 1> translation;
  double mean_squared_error = 0.0;
};
// Sizes must be equal and positive. A scale that does not exist (coinciding points) is 1.
template <int dimension>
SimilarityTransform<dimension> Umeyama(const Eigen::Matrix<double, dimension, Eigen::Dynamic>& from,
                                       const Eigen::Matrix<double, dimension, Eigen::Dynamic>& to,
                                       bool with_scale);

extern template SimilarityTransform<2> Umeyama<2>(const Eigen::Matrix2Xd&, const Eigen::Matrix2Xd&,
                                                  bool);
extern template SimilarityTransform<3> Umeyama<3>(const Eigen::Matrix3Xd&, const Eigen::Matrix3Xd&,
                                                  bool);

}  // namespace portolan

#endif  // PORTOLAN_COMMON_TRAJECTORY_ALIGNMENT_H_
