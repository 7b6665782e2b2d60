// Samples of a laser range finder fixed to the camera of a mission.
#ifndef PORTOLAN_TESTS_SYNTHETIC_RANGES_H_
#define PORTOLAN_TESTS_SYNTHETIC_RANGES_H_

#include <optional>
#include <vector>

#include "tests/synthetic/mission.h"

namespace portolan::synthetic {

// Where it sits and points, in the camera frame, and the noise of a range.
struct RangeMount {
  Eigen::Vector3d position_in_camera_m = {0.06, -0.04, 0.01};
  Eigen::Vector3d direction_in_camera = Eigen::Vector3d(-0.03, 0.02, 1).normalized();
  double sigma_m = 0.02;
};

struct RangeSample {
  Duration time_since_start{};
  double range_m = 0;
};

// To the nearest surface along a unit direction; no value if nothing is hit.
std::optional<double> CastRay(const World& world, const Eigen::Vector3d& origin,
                              const Eigen::Vector3d& direction);

// mission.options.range_rate_hz samples a second from the first image to the last, not at the
// images' times; a range of zero where nothing is hit.
std::vector<RangeSample> SimulateRanges(const Mission& mission, int agent,
                                        const RangeMount& mount = {});

}  // namespace portolan::synthetic

#endif  // PORTOLAN_TESTS_SYNTHETIC_RANGES_H_
