#include "server/pose_graph/pose_graph.h"

#include "server/pose_graph/pose_errors.h"

namespace portolan {

double Chi2(const PoseGraph3& graph) {
  const auto parameters = [&graph](int node) {
    const Rigid3& pose = graph.world_from_node[static_cast<size_t>(node)];
    Vector7d packed;
    packed << pose.rotation.coeffs(), pose.translation;
    return packed;
  };
  double chi2 = 0;
  for (const PoseEdge3& edge : graph.edges) {
    const Vector6d error =
        PoseError3<double>(edge, parameters(edge.a).data(), parameters(edge.b).data());
    chi2 += error.dot(edge.information * error);
  }
  return chi2;
}

double Chi2(const PoseGraph2& graph) {
  double chi2 = 0;
  for (const PoseEdge2& edge : graph.edges) {
    const Eigen::Vector3d error =
        PoseError2<double>(edge, graph.world_from_node[static_cast<size_t>(edge.a)].data(),
                           graph.world_from_node[static_cast<size_t>(edge.b)].data());
    chi2 += error.dot(edge.information * error);
  }
  return chi2;
}

}  // namespace portolan
