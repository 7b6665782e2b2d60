// Where a window lies by the landmarks of the map that its keyframes see.
#ifndef PORTOLAN_AGENT_LOCAL_ADJUSTMENT_KNOWN_FIT_H_
#define PORTOLAN_AGENT_LOCAL_ADJUSTMENT_KNOWN_FIT_H_

#include <optional>
#include <vector>

#include "agent/revisit/known_landmark.h"
#include "common/base/status.h"
#include "common/camera/camera_model.h"
#include "common/geometry/similarity3.h"

namespace portolan {

struct KnownFitOptions {
  // How far the window has drifted since the server has put it in the world, sigmas: share of the
  // scene's depth, rad, log scale.
  double translation_of_depth = 0.005;
  double rotation_rad = 0.0025;
  double log_scale = 0.0025;
  // ... or so many times farther, where the map itself has drifted before its own closures: as
  // likely, but spread over as much more, so that a few false or vague sights do not speak for it.
  double map_drift_factor = 20;
  // Errors beyond this many sigmas weigh less (Cauchy).
  double loss_scale_sigmas = 2.0;
  int max_iterations = 5;
  // Fewer sights tell nothing; every keyframe's sight of a landmark is one.
  int min_sights = 12;

  Status Validate() const;
};

// A sight of a keyframe that lies at window_from_camera.
struct KnownView {
  Rigid3 window_from_camera;
  const KnownSight* sight = nullptr;  // not owned
};

// The similarity that moves all keyframes at once so that they fit their sights best. A landmark
// counts once, however many keyframes see it: the greater part of its error is its own.
// moved_before: by what it has moved since it was put there. No value if there are too few sights.
std::optional<Similarity3> FitToKnown(const KnownFitOptions& options, const CameraModel& camera,
                                      const std::vector<KnownView>& views, double scene_depth,
                                      const Similarity3& moved_before);

}  // namespace portolan

#endif  // PORTOLAN_AGENT_LOCAL_ADJUSTMENT_KNOWN_FIT_H_
