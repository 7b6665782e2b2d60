// Tracked points as the filter and the second camera take them.
#ifndef PORTOLAN_AGENT_AGENT_MEASUREMENTS_H_
#define PORTOLAN_AGENT_AGENT_MEASUREMENTS_H_

#include <vector>

#include "agent/filter/measurement.h"
#include "agent/tracker/tracker.h"

namespace portolan {

// Of the points whose tracks are wanted, a predicate.
inline std::vector<Measurement> MeasurementsOf(const std::vector<TrackedPoint>& points,
                                               const auto& is_wanted) {
  std::vector<Measurement> measurements;
  measurements.reserve(points.size());
  for (const TrackedPoint& point : points) {
    if (is_wanted(point.track)) {
      measurements.push_back({point.track, point.pixel, point.sigma_px});
    }
  }
  return measurements;
}

}  // namespace portolan

#endif  // PORTOLAN_AGENT_AGENT_MEASUREMENTS_H_
