// Pose graph files in g2o's text format: VERTEX_SE3:QUAT, EDGE_SE3:QUAT, VERTEX_SE2, EDGE_SE2, FIX.
#ifndef PORTOLAN_SERVER_POSE_GRAPH_G2O_FILE_H_
#define PORTOLAN_SERVER_POSE_GRAPH_G2O_FILE_H_

#include <string>
#include <variant>

#include "common/base/status.h"
#include "server/pose_graph/pose_graph.h"

namespace portolan {

// Reads a file of one dimension. Errors name file and line: an unknown tag, a number that is none
// or not finite, a zero quaternion, a node defined twice or not at all, mixed dimensions.
StatusOr<std::variant<PoseGraph3, PoseGraph2>> ReadG2o(const std::string& path);

// Both write atomically: a temporary file that is renamed.
Status WriteG2o(const std::string& path, const PoseGraph3& graph);
Status WriteG2o(const std::string& path, const PoseGraph2& graph);

// The poses as a TUM trajectory, the node's id as the time; a 2-D graph lies in the plane z = 0.
Status WriteTumOfGraph(const std::string& path, const PoseGraph3& graph);
Status WriteTumOfGraph(const std::string& path, const PoseGraph2& graph);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_POSE_GRAPH_G2O_FILE_H_
