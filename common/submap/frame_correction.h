// Puts the poses of a submap's frames in the world once the server has solved for its keyframes.
#ifndef PORTOLAN_COMMON_SUBMAP_FRAME_CORRECTION_H_
#define PORTOLAN_COMMON_SUBMAP_FRAME_CORRECTION_H_

#include <vector>

#include "common/base/time.h"
#include "common/geometry/similarity3.h"

namespace portolan {

// A keyframe before and after the server's adjustment.
struct CorrectedKeyframe {
  Timestamp time{};
  Rigid3 submap_from_camera;  // the filter's
  Rigid3 world_from_camera;   // the server's
};

// Where the server puts one submap.
struct SubmapCorrection {
  Similarity3 world_from_submap;
  // Ascending time; may be empty, then world_from_submap alone places the frames.
  std::vector<CorrectedKeyframe> keyframes;
};

// World pose of a frame at `time` that the filter placed at submap_from_camera. Between two
// keyframes the corrections of both, as Sim(3) with the submap's scale, are interpolated in time
// on the geodesic; outside, the nearest keyframe's holds. Continuous at the keyframes, where it
// equals world_from_camera.
Rigid3 CorrectFrame(const SubmapCorrection& correction, Timestamp time,
                    const Rigid3& submap_from_camera);

}  // namespace portolan

#endif  // PORTOLAN_COMMON_SUBMAP_FRAME_CORRECTION_H_
