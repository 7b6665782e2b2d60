// Bundle adjustment of a window of the map, or of a whole component, from raw observations: shared
// keyframes are one camera, the tracks of a session and the matched tracks of closures are one
// landmark.
#ifndef PORTOLAN_SERVER_ALIGNMENT_MAP_ADJUSTER_H_
#define PORTOLAN_SERVER_ALIGNMENT_MAP_ADJUSTER_H_

#include <atomic>
#include <set>
#include <vector>

#include "server/alignment/map_model.h"
#include "server/refinement/bundle_adjuster.h"
#include "server/refinement/triangulation.h"

namespace portolan {

struct MapAdjusterOptions {
  BundleOptions bundle;
  // For landmarks that lost their observations; poses are good by then.
  TriangulationOptions triangulation;
  // Relative standard deviation of the length of a metric submap's path; sensors with an IMU or
  // odometry reach a percent.
  double metric_log_scale_sigma = 0.02;

  Status Validate() const;
};

struct MapAdjustment {
  BundleSummary summary;
  int cameras = 0;  // free ones
  int landmarks = 0;
  int observations = 0;
};

// Adjusts the cameras of `window` (submaps of one component) and every landmark they see; cameras
// of other submaps that see these landmarks are held. If nothing is held, the component's oldest
// camera is, and unless the submaps are metric, its distance to the farthest camera. `passes`
// counts solves; between two, landmarks without inliers are triangulated again. Afterwards
// world_from_submap follows the cameras. Deterministic with one thread.
MapAdjustment AdjustMap(const MapAdjusterOptions& options, const std::vector<SubmapId>& window,
                        int passes, const std::atomic<bool>* interrupt, MapModel* model);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_ALIGNMENT_MAP_ADJUSTER_H_
