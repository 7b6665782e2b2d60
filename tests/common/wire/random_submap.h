// Submaps of typical content for tests of the wire and of the uplink: a camera that drifts
// sideways past random points with jitter.
#ifndef PORTOLAN_TESTS_COMMON_WIRE_RANDOM_SUBMAP_H_
#define PORTOLAN_TESTS_COMMON_WIRE_RANDOM_SUBMAP_H_

#include <cstdint>

#include "common/submap/submap.h"

namespace portolan {

struct RandomSubmapOptions {
  uint32_t seed = 1;
  uint32_t sequence_number = 0;
  int keyframes = 12;
  int observations = 200;  // a keyframe
  int landmarks = 50;
  int described_keyframes = 2;
  int features = 400;  // a described keyframe
  int frames = 90;
};

Submap RandomSubmap(const RandomSubmapOptions& options);

}  // namespace portolan

#endif  // PORTOLAN_TESTS_COMMON_WIRE_RANDOM_SUBMAP_H_
