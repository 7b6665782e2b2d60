// Landmarks of other agents, as the server offers them to one that is near.
#ifndef PORTOLAN_COMMON_SUBMAP_LANDMARK_OFFER_H_
#define PORTOLAN_COMMON_SUBMAP_LANDMARK_OFFER_H_

#include <cstdint>
#include <vector>

#include "common/base/strong_id.h"
#include "common/features/descriptor.h"
#include "common/geometry/similarity3.h"

namespace portolan {

struct OfferedLandmark {
  // In the camera of the view; in front of it.
  Eigen::Vector3d point_in_camera = Eigen::Vector3d::Zero();
  // Across and along the view's ray, shares of the depth.
  double lateral_sigma = 0;
  double depth_sigma = 0;
  Descriptor descriptor;
};

// Landmarks that one described keyframe, the view, sees. They keep their places in its camera; the
// view moves with the map.
struct LandmarkOffer {
  // The view's name in the map; not 0.
  uint64_t view = 0;
  ComponentId component;
  Similarity3 world_from_camera;
  // So many landmarks of the view were told before. None may follow: then only the view moved.
  uint32_t first_index = 0;
  std::vector<OfferedLandmark> landmarks;
};

}  // namespace portolan

#endif  // PORTOLAN_COMMON_SUBMAP_LANDMARK_OFFER_H_
