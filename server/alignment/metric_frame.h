// What the metric submaps of a component say about its scale and its vertical.
#ifndef PORTOLAN_SERVER_ALIGNMENT_METRIC_FRAME_H_
#define PORTOLAN_SERVER_ALIGNMENT_METRIC_FRAME_H_

#include <map>
#include <optional>
#include <vector>

#include "common/base/status.h"
#include "common/geometry/similarity3.h"
#include "server/alignment/map_model.h"

namespace portolan {

struct MetricFrameOptions {
  // No submap's scale is believed better than this (log): a filter's covariance does not know of
  // its own linearisation, nor of the accelerometer's scale error.
  double min_log_scale_sigma = 0.01;
  // Submaps of one session share the error of their scale, for the filter carries it over: this
  // many together tell as much as the best of them.
  int correlated_submaps = 10;
  // A submap farther off than this many sigmas loses its weight (Cauchy).
  double outlier_sigmas = 3.0;
  // The world is moved when the scale is off by more than this (log), or the vertical [rad].
  double min_log_scale_step = 0.002;
  double min_rotation_step_rad = 0.002;

  Status Validate() const;
};

// Metres a unit of the world, by one submap's filter.
struct ScaleMeasurement {
  double log_scale = 0;
  double sigma = 1;
};

// Compares the filter's landmarks with the same landmarks as the map has them. The sigma is that
// which the best known ranges have in common. No value if the submap is not metric, is quarantined
// or shares too few landmarks with the map.
std::optional<ScaleMeasurement> MeasureScale(const MetricFrameOptions& options,
                                             const MapModel& model, SubmapId id);

// The measurements of these submaps, their sigmas widened so that together they tell no more than
// their correlation allows.
std::map<SubmapId, ScaleMeasurement> MeasureScales(const MetricFrameOptions& options,
                                                   const MapModel& model,
                                                   const std::vector<SubmapId>& submaps);

// What moves the world of the submaps to metres and to a vertical z axis (up): scale about the
// origin by the weighted robust mean, and the smallest turn that makes the mean gravity point
// down. Identity where there is no evidence or it agrees already.
Similarity3 MetricFromWorld(const MetricFrameOptions& options, const MapModel& model,
                            const std::vector<SubmapId>& submaps);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_ALIGNMENT_METRIC_FRAME_H_
