// Runs synthetic missions through the map builder and compares the map with the truth.
#ifndef PORTOLAN_TESTS_SUPPORT_SYNTHETIC_MAP_H_
#define PORTOLAN_TESTS_SUPPORT_SYNTHETIC_MAP_H_

#include <Eigen/Core>
#include <vector>

#include "server/fusion/map_state.h"
#include "server/map_builder.h"
#include "tests/support/synthetic_submaps.h"

namespace portolan {

// Integrates submaps [begin, end) in order; with `polish` all background work is awaited after
// each.
void IntegrateMission(const SyntheticMission& mission, size_t begin, size_t end, bool polish,
                      MapBuilder* builder);

// Runs background work until there is none.
void FinishBackgroundWork(MapBuilder* builder);

// Root mean square error of all keyframes of the component after one alignment, metres.
double KeyframeRms(const SyntheticMission& mission, const MapSnapshot& snapshot,
                   ComponentId component, bool with_scale = true);

// Median error of the component's fused landmarks in the same alignment, metres.
double LandmarkMedianError(const SyntheticMission& mission, const MapSnapshot& snapshot,
                           ComponentId component);

}  // namespace portolan

#endif  // PORTOLAN_TESTS_SUPPORT_SYNTHETIC_MAP_H_
