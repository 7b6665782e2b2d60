// What a map relaxation is made of: submaps with two ends, and their views of landmarks.
#ifndef PORTOLAN_SERVER_ALIGNMENT_RELAXATION_ELEMENTS_H_
#define PORTOLAN_SERVER_ALIGNMENT_RELAXATION_ELEMENTS_H_

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "common/base/strong_id.h"
#include "common/geometry/similarity3.h"
#include "server/refinement/refined_submap.h"

namespace portolan {

// A submap's two ends. Its frame, by which their tangents are measured, is the start's.
struct RelaxationBody {
  SubmapId id;
  Similarity3 world_from_submap;
  Similarity3 submap_from_world;
  std::array<int, 2> nodes;  // start and end; the end is the successor's start
  // Tangents at the end node, which are in the successor's frame, in this one's.
  Matrix7d from_end = Matrix7d::Identity();
  int last_keyframe = 0;
  std::shared_ptr<const CameraModel> camera;
  std::vector<Rigid3> world_from_camera;
  // How the world about each camera moved.
  std::vector<Similarity3> moved;

  double PartOf(int keyframe) const {
    return last_keyframe == 0 ? 0.0 : static_cast<double>(keyframe) / last_keyframe;
  }
};

// One observation.
struct RelaxationSight {
  int body = 0;
  uint16_t keyframe = 0;
  bool inlier = true;
  Eigen::Vector2f pixel = Eigen::Vector2f::Zero();
  float sigma_px = 1;
};

// A landmark that takes part, and its observations.
struct RelaxationPoint {
  int landmark = 0;  // in the model
  Eigen::Vector3d in_world = Eigen::Vector3d::Zero();
  Eigen::Vector3d at_start = Eigen::Vector3d::Zero();
  int owner = -1;  // body of the oldest sight; -1 if it is not among them
  size_t begin = 0;
  size_t end = 0;
};

using Matrix37d = Eigen::Matrix<double, 3, 7>;

// Derivative of the point by tangents at the submap's start and end, if all of it moved by them.
inline std::array<Matrix37d, 2> PointJacobians(const RelaxationBody& body,
                                               const Eigen::Vector3d& point) {
  const Similarity3& frame = body.world_from_submap;
  const Eigen::Vector3d in_submap = body.submap_from_world * point;
  const Eigen::Matrix3d scaled = frame.scale * frame.rotation.toRotationMatrix();
  std::array<Matrix37d, 2> jacobians;
  jacobians[0].leftCols<3>() = scaled;
  jacobians[0].middleCols<3>(3) = -scaled * Skew(in_submap);
  jacobians[0].col(6) = scaled * in_submap;
  jacobians[1] = jacobians[0] * body.from_end;
  return jacobians;
}

// What the cameras of one submap say about one landmark: sums of J' J and J' r, J with respect to
// the landmark, weighted by the cameras' shares of the start's and the end's movement.
struct RelaxationView {
  int body = 0;
  std::array<Eigen::Matrix3d, 2> cross;  // start and end: sum of share J' J
  Eigen::Matrix3d start_start, start_end, end_end;
  std::array<Eigen::Vector3d, 2> gradient;  // sum of share J' r

  explicit RelaxationView(int of_body) : body(of_body) {
    cross.fill(Eigen::Matrix3d::Zero());
    start_start.setZero();
    start_end.setZero();
    end_end.setZero();
    gradient.fill(Eigen::Vector3d::Zero());
  }
};

struct LinearLandmark {
  std::vector<RelaxationView> views;
  double cost = 0;
  Eigen::Matrix3d inverse_information = Eigen::Matrix3d::Zero();
  Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
  std::vector<bool> used;    // of the sights
  std::vector<double> chi2;  // of those used
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_ALIGNMENT_RELAXATION_ELEMENTS_H_
