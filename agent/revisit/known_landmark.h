// Landmarks of the map that do not come from the window: where the server has them.
#ifndef PORTOLAN_AGENT_REVISIT_KNOWN_LANDMARK_H_
#define PORTOLAN_AGENT_REVISIT_KNOWN_LANDMARK_H_

#include <Eigen/Core>
#include <compare>
#include <cstdint>
#include <vector>

#include "common/features/descriptor.h"

namespace portolan {

// Which group of landmarks: an own submap, by its sequence number, or an offered view.
struct KnownGroupId {
  bool offered = false;
  uint64_t number = 0;

  friend auto operator<=>(const KnownGroupId&, const KnownGroupId&) = default;
};

struct KnownLandmarkId {
  KnownGroupId group;
  uint32_t index = 0;    // in its group
  uint64_t filling = 0;  // KnownGroup::filling

  friend auto operator<=>(const KnownLandmarkId&, const KnownLandmarkId&) = default;
};

struct KnownLandmark {
  Eigen::Vector3d point_in_world = Eigen::Vector3d::Zero();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  // A camera that described it.
  Eigen::Vector3d seen_from_in_world = Eigen::Vector3d::Zero();
  std::vector<Descriptor> descriptors;
};

// A known landmark found in a keyframe.
struct KnownSight {
  KnownLandmarkId landmark;
  Eigen::Vector3d point_in_world = Eigen::Vector3d::Zero();
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  // The landmark's own uncertainty included.
  double sigma_px = 1;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_REVISIT_KNOWN_LANDMARK_H_
