// Comparison of two servers' maps.
#ifndef PORTOLAN_TESTS_END_TO_END_MAP_POSITIONS_H_
#define PORTOLAN_TESTS_END_TO_END_MAP_POSITIONS_H_

#include <Eigen/Core>
#include <map>
#include <string>
#include <utility>

#include "common/client/map_client.h"

namespace portolan::testing {

// Positions by agent and time in nanoseconds, in the world frame of each one's component.
using KeyframePositions = std::map<std::pair<std::string, int64_t>, Eigen::Vector3d>;

// The keyframes of all agents. A failing query fails the test.
KeyframePositions ReadKeyframePositions(const MapClient& client);
// Largest distance between the same keyframes; infinite if they are not the same ones, or none.
double WorstDifference(const KeyframePositions& a, const KeyframePositions& b);

}  // namespace portolan::testing

#endif  // PORTOLAN_TESTS_END_TO_END_MAP_POSITIONS_H_
