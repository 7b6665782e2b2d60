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
  // How far the window has drifted, sigmas: share of the scene's depth, rad, log scale.
  double translation_of_depth = 0.1;
  double rotation_rad = 0.05;
  double log_scale = 0.05;
  // Errors beyond this many sigmas weigh less (Cauchy).
  double loss_scale_sigmas = 2.0;
  int max_iterations = 5;
  // Fewer sights tell nothing.
  int min_sights = 12;

  Status Validate() const;
};

// A sight of a keyframe that lies at window_from_camera.
struct KnownView {
  Rigid3 window_from_camera;
  const KnownSight* sight = nullptr;  // not owned
};

// The similarity that moves all keyframes at once so that they fit their sights best. No value if
// there are too few.
std::optional<Similarity3> FitToKnown(const KnownFitOptions& options, const CameraModel& camera,
                                      const std::vector<KnownView>& views, double scene_depth);

}  // namespace portolan

#endif  // PORTOLAN_AGENT_LOCAL_ADJUSTMENT_KNOWN_FIT_H_
