#include "tests/end_to_end/map_positions.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

namespace portolan::testing {

KeyframePositions ReadKeyframePositions(const MapClient& client) {
  KeyframePositions positions;
  const auto agents = client.ListAgents();
  EXPECT_TRUE(agents.ok()) << agents.status();
  if (!agents.ok()) return positions;
  for (const v1::AgentInfo& agent : agents->agents()) {
    v1::GetTrajectoryRequest request;
    request.set_agent_id(agent.agent_id());
    request.set_kind(v1::TRAJECTORY_KIND_KEYFRAMES);
    const auto segments = client.GetTrajectory(request);
    EXPECT_TRUE(segments.ok()) << segments.status();
    if (!segments.ok()) continue;
    for (const v1::TrajectorySegment& segment : *segments) {
      for (int i = 0; i < segment.time_ns_size(); ++i) {
        const double* pose = segment.world_from_camera().data() + 7 * i;
        positions[{agent.agent_id(), segment.time_ns(i)}] = {pose[4], pose[5], pose[6]};
      }
    }
  }
  return positions;
}

double WorstDifference(const KeyframePositions& a, const KeyframePositions& b) {
  double worst = a.size() == b.size() && !a.empty() ? 0 : std::numeric_limits<double>::infinity();
  for (const auto& [key, position] : a) {
    const auto other = b.find(key);
    if (other == b.end()) return std::numeric_limits<double>::infinity();
    worst = std::max(worst, (other->second - position).norm());
  }
  return worst;
}

}  // namespace portolan::testing
