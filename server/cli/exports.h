// Text formats of other programs, out of the server's answers.
#ifndef PORTOLAN_SERVER_CLI_EXPORTS_H_
#define PORTOLAN_SERVER_CLI_EXPORTS_H_

#include <ostream>
#include <vector>

#include "proto/map_service.pb.h"

namespace portolan {

// TUM trajectory: `timestamp[s] tx ty tz qx qy qz qw`, one pose a line.
void WriteTum(const std::vector<v1::TrajectorySegment>& segments, std::ostream& out);

// ASCII PLY points: x y z in world units, standard deviation (root of the largest variance on the
// diagonal), number of observations, and of agents.
void WritePly(const v1::LandmarkPage& page, std::ostream& out);

// g2o pose graph of one component: VERTEX_SE3:QUAT a submap, EDGE_SE3:QUAT a link or closure, in
// world units. A similarity's scale is not part of the format: it is folded into the translations
// and marginalised out of the information, whose rotation part is that of the quaternion's vector
// part. A comment before each vertex gives its time in seconds, agent and number.
void WriteG2o(const v1::PoseGraphPage& graph, std::ostream& out);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_CLI_EXPORTS_H_
