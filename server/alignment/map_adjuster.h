// Bundle adjustment of a window of the map, or of a whole component, from raw observations: shared
// keyframes are one camera, the tracks of a session and the matched tracks of closures are one
// landmark.
#ifndef PORTOLAN_SERVER_ALIGNMENT_MAP_ADJUSTER_H_
#define PORTOLAN_SERVER_ALIGNMENT_MAP_ADJUSTER_H_

#include <atomic>
#include <vector>

#include "common/bundle/triangulation.h"
#include "server/alignment/map_model.h"
#include "server/alignment/metric_frame.h"
#include "server/alignment/position_references.h"
#include "server/refinement/bundle_adjuster.h"

namespace portolan {

struct MapAdjusterOptions {
  BundleOptions bundle;
  // For landmarks that lost their observations; poses are good by then.
  TriangulationOptions triangulation;
  // How far the metric submaps are believed.
  MetricFrameOptions metric;
  // A metric submap whose path is shorter than this share of its scene's depth has no say: a
  // distance of next to nothing tells no scale.
  double min_metric_path_of_depth = 0.05;
  // How far a fix may be off before it loses weight.
  GeoreferenceFitOptions positions;
  // Lenses of sessions with so many free keyframes are adjusted wherever no keyframe is held, in
  // the component that has most of the session; 0: never. Redundant ones count, for those that stay
  // tell enough. How far lenses may be off, at the image's corner: one that was never calibrated is
  // by 5 to 10 px.
  int min_lens_keyframes = 24;
  double lens_corner_sigma_px = 5.0;
  // A calibration with distortion is believed. What the map finds for such a lens is about as good:
  // with it MH_01, checkerboard and desk keep their ATE within 0.1 mm, scenelib's, whose reference
  // owes itself to the same calibration, goes from 3.1 to 4.6 mm.
  bool trust_distortion = true;
  // Squared error, in sigmas, up to which a control point's observation takes part at first.
  double control_point_chi2 = 400.0;
  // Where a component settles: the relative decrease of the cost under which a solve ends, and
  // rounds of solve and outlier test. A large component's softest bends cost next to nothing.
  double settling_tolerance = 1e-7;
  int settling_rounds = 4;
  // Of two minima whose costs differ by less than this share, the one that depends less on the
  // history is taken: they differ in which of thousands of observations are outliers.
  double settling_preference = 1.5e-3;
  // With more free cameras an iteration takes seconds, and a hundred of them are too many. There
  // landmarks are triangulated anew from all their observations, between two adjustments to the
  // end. Their softest bends, which cost next to nothing, are held back by an adjustment's damping
  // and by its prior of depths, which holds on to where each solve began: both are weaker here, the
  // prior's sigmas by this factor.
  int max_cameras_anew = 2000;
  double settling_damping = 1e-9;
  double settling_depth_prior = 10.0;

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
// camera is, and unless a metric submap tells the scale, most cameras' distance from it.
// `passes` counts solves; between two, landmarks without inliers are triangulated again. Afterwards
// world_from_submap follows the cameras. Deterministic with one thread.
// `positions` (null for none; the window is a component whose world is the site frame): fixes pull
// at the cameras nearest in time, and control points are landmarks that stay; then no camera is
// held.
MapAdjustment AdjustMap(const MapAdjusterOptions& options, const std::vector<SubmapId>& window,
                        int passes, const std::atomic<bool>* interrupt, MapModel* model,
                        const PositionReferences* positions = nullptr);

// The same for a whole component that was adjusted, so that how it got there matters little: which
// observations are outliers depends on those that were, and an adjustment comes to rest in the next
// one of many minima. Adjusts to the end, then from there anew, robustly, with every observation;
// keeps what fits better. A large one is adjusted, its landmarks triangulated anew, and adjusted
// again. Interrupted, it keeps what it had, as far as it got.
MapAdjustment SettleMap(const MapAdjusterOptions& options, const std::vector<SubmapId>& window,
                        const std::atomic<bool>* interrupt, MapModel* model,
                        const PositionReferences* positions = nullptr);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_ALIGNMENT_MAP_ADJUSTER_H_
