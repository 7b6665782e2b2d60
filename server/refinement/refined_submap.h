// A submap after its own bundle adjustment: what the later stages match, align and fuse.
#ifndef PORTOLAN_SERVER_REFINEMENT_REFINED_SUBMAP_H_
#define PORTOLAN_SERVER_REFINEMENT_REFINED_SUBMAP_H_

#include <memory>
#include <string>
#include <vector>

#include "common/camera/camera_model.h"
#include "common/linear_algebra/symmetric3.h"
#include "common/submap/submap.h"

namespace portolan {

// A landmark triangulated from the submap's own observations only, hence independent of every
// other submap. Lengths in submap units.
struct RefinedLandmark {
  TrackId track;
  int observation_count = 0;
  Eigen::Vector3d point_in_submap = Eigen::Vector3d::Zero();
  // Large along the ray where the parallax is small; always positive definite.
  Symmetric3 covariance;
  int redundant_count = 0;  // observations, of those above, in redundant keyframes
};

struct RefinedSubmap {
  SubmapId id;
  std::shared_ptr<const Submap> raw;
  std::shared_ptr<const CameraModel> camera;
  // Adjusted poses, parallel to raw->keyframes; the first is the identity.
  std::vector<Rigid3> submap_from_camera;
  // Of the right perturbation [translation; rotation] of the last pose, where a connected
  // successor hangs; gauge: first keyframe fixed, and the norm of all translations (the scale).
  Matrix6d last_keyframe_covariance = Matrix6d::Zero();
  // Ascending track id. Empty if quarantined.
  std::vector<RefinedLandmark> landmarks;
  // Ascending; keyframes that tell the joint map nothing new (server/redundancy): it takes none of
  // their observations, and their poses follow the neighbours'. Never the first or the last.
  std::vector<int> redundant_keyframes;
  double rms_reprojection_px = 0;
  // Not empty: the submap is kept but never fused, for this reason.
  std::string quarantine_reason;
};

// Which of a refined submap's raw observations agree with it: for keyframe k and observation i of
// it, result[k][i]. Observations of tracks without a landmark do not.
std::vector<std::vector<bool>> AgreeingObservations(const RefinedSubmap& submap, double max_chi2);

bool IsRedundant(const RefinedSubmap& submap, int keyframe);
// The keyframe itself, or the nearest one by number, before or behind it, that is not redundant.
int EssentialKeyframeBefore(const RefinedSubmap& submap, int keyframe);
int EssentialKeyframeBehind(const RefinedSubmap& submap, int keyframe);

// The landmark of a track; null if it has none.
const RefinedLandmark* FindLandmark(const RefinedSubmap& submap, TrackId track);

// Median distance of the landmarks from the submap's origin in submap units; 1 without landmarks.
double MedianDepth(const RefinedSubmap& submap);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_REFINEMENT_REFINED_SUBMAP_H_
