// Error of a map of a replayed fleet against the truth.
#ifndef PORTOLAN_TESTS_BENCHMARK_REPLAY_MAP_ERROR_H_
#define PORTOLAN_TESTS_BENCHMARK_REPLAY_MAP_ERROR_H_

#include <vector>

#include "server/fusion/map_state.h"

namespace portolan {

struct MapError {
  int components = 0;
  int quarantined = 0;
  // Of the component with the most submaps, after one Sim(3) alignment.
  int submaps = 0;
  double ate_m = 0;
  double path_m = 0;  // length of the true paths of its submaps
  // Closures of all components.
  int accepted_right = 0;
  int accepted_wrong = 0;
  int waiting_right = 0;
  int waiting_wrong = 0;
};

// truth[i]: true camera poses of the submap with id i + 1.
MapError ErrorOf(const MapSnapshot& snapshot, const std::vector<std::vector<Rigid3>>& truth);

// RMS distance [m] between the keyframes of two maps of the same submaps, after one Sim(3)
// alignment of their components with the most submaps; NaN if these do not hold the same keyframes.
double DistanceBetween(const MapSnapshot& a, const MapSnapshot& b,
                       const std::vector<std::vector<Rigid3>>& truth);

}  // namespace portolan

#endif  // PORTOLAN_TESTS_BENCHMARK_REPLAY_MAP_ERROR_H_
