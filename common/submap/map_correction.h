// Where the server puts the submaps of one session, as it travels to the agent.
#ifndef PORTOLAN_COMMON_SUBMAP_MAP_CORRECTION_H_
#define PORTOLAN_COMMON_SUBMAP_MAP_CORRECTION_H_

#include <cstdint>
#include <vector>

#include "common/base/strong_id.h"
#include "common/geometry/similarity3.h"
#include "common/submap/landmark_offer.h"

namespace portolan {

struct SubmapPlacement {
  // Of the submap in the session.
  uint32_t sequence_number = 0;
  // The component whose world is meant.
  ComponentId component;
  // World lengths are metres.
  bool metric = false;
  Similarity3 world_from_submap;
  // Variances of the right perturbation of world_from_submap relative to the component's oldest
  // submap: translation (submap units^2), rotation (rad^2), log scale.
  Vector7d covariance_diagonal = Vector7d::Zero();
  // Adjusted poses of the submap's keyframes, in submap units, in the order of the upload:
  // world_from_camera = world_from_submap * adjusted_submap_from_camera. Empty, or as many as the
  // submap has keyframes.
  std::vector<Rigid3> adjusted_submap_from_camera;
  // k1 and k2 of the session's lens as the map has found it, less the calibration's.
  Eigen::Vector2d added_radial = Eigen::Vector2d::Zero();
};

struct MapCorrection {
  uint64_t map_version = 0;
  std::vector<SubmapPlacement> submaps;  // ascending sequence number
  // More parts of this version follow.
  bool more = false;
  // Landmarks that the agent may look for.
  std::vector<LandmarkOffer> offers = {};
};

}  // namespace portolan

#endif  // PORTOLAN_COMMON_SUBMAP_MAP_CORRECTION_H_
