// Pose graphs in three and in two dimensions: poses and relative measurements between them.
#ifndef PORTOLAN_SERVER_POSE_GRAPH_POSE_GRAPH_H_
#define PORTOLAN_SERVER_POSE_GRAPH_POSE_GRAPH_H_

#include <cstdint>
#include <vector>

#include "common/geometry/rigid3.h"

namespace portolan {

// One relative measurement in three dimensions. The error is that of g2o's EDGE_SE3:QUAT,
//   e = [translation; quaternion vector part, scalar part >= 0] of  a_from_b^-1 * (x_a^-1 * x_b),
// and its cost e' * information * e.
struct PoseEdge3 {
  int a = 0;
  int b = 0;
  Rigid3 a_from_b;
  Matrix6d information = Matrix6d::Identity();
};

struct PoseGraph3 {
  std::vector<int64_t> ids;             // names of the nodes in the file
  std::vector<Rigid3> world_from_node;  // parallel to ids
  std::vector<PoseEdge3> edges;         // a and b index the nodes
  std::vector<int> fixed;               // nodes held where they are
};

// One relative measurement in the plane; poses are (x, y, heading [rad]). The error is that of
// g2o's EDGE_SE2: a_from_b^-1 * (x_a^-1 * x_b), heading wrapped to +-pi.
struct PoseEdge2 {
  int a = 0;
  int b = 0;
  Eigen::Vector3d a_from_b = Eigen::Vector3d::Zero();
  Eigen::Matrix3d information = Eigen::Matrix3d::Identity();
};

struct PoseGraph2 {
  std::vector<int64_t> ids;
  std::vector<Eigen::Vector3d> world_from_node;
  std::vector<PoseEdge2> edges;
  std::vector<int> fixed;
};

// Sum of e' * information * e over the edges, without the factor 1/2 (g2o's convention).
double Chi2(const PoseGraph3& graph);
double Chi2(const PoseGraph2& graph);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_POSE_GRAPH_POSE_GRAPH_H_
