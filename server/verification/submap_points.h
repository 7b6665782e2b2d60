// A refined submap seen as a set of described points, ready to be matched with another's.
#ifndef PORTOLAN_SERVER_VERIFICATION_SUBMAP_POINTS_H_
#define PORTOLAN_SERVER_VERIFICATION_SUBMAP_POINTS_H_

#include <cstdint>
#include <optional>
#include <vector>

#include "common/features/descriptor_table.h"
#include "server/refinement/refined_submap.h"

namespace portolan {

// One sight of a point.
struct PointView {
  int keyframe = 0;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double sigma_px = 1.0;
  // Unit ray in the camera; only in described keyframes.
  std::optional<Eigen::Vector3d> bearing;
};

// A track, or an untracked feature.
struct SubmapPoint {
  std::optional<TrackId> track;
  const RefinedLandmark* landmark = nullptr;  // null if its depth is unknown
  std::vector<PointView> views;               // ascending keyframe, at most one each
};

// The features of one keyframe.
struct DescribedKeyframe {
  int keyframe = 0;
  DescriptorTable descriptors;
  std::vector<int> points;  // parallel, index into SubmapPoints::points
  std::vector<Eigen::Vector2f> pixels;
  std::vector<uint8_t> half_octaves;
};

// Refers to the submap it was made of, which must outlive it.
struct SubmapPoints {
  const RefinedSubmap* submap = nullptr;
  std::vector<SubmapPoint> points;
  std::vector<DescribedKeyframe> keyframes;
  std::vector<Rigid3> camera_from_submap;  // a keyframe each
};

// Features further than max_features a keyframe are thinned evenly; features and observations
// that the camera cannot have seen (not finite, no bearing) are left out. No value if the submap
// is quarantined, or incomplete, or holds no usable feature or landmark.
std::optional<SubmapPoints> MakeSubmapPoints(const RefinedSubmap& submap, int max_features);

// The point's sight in a keyframe, or null.
const PointView* ViewIn(const SubmapPoint& point, int keyframe);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_VERIFICATION_SUBMAP_POINTS_H_
