// A wall of described points and a submap that saw them, in units of a half of the world's.
#ifndef PORTOLAN_TESTS_AGENT_REVISIT_WALL_SCENE_H_
#define PORTOLAN_TESTS_AGENT_REVISIT_WALL_SCENE_H_

#include <vector>

#include "common/camera/camera_model.h"
#include "common/geometry/similarity3.h"
#include "common/submap/frame_correction.h"
#include "common/submap/landmark_offer.h"
#include "common/submap/submap.h"

namespace portolan {

inline constexpr int kWallPoints = 150;
inline constexpr double kWallScale = 2;
inline const ComponentId kWallWorld{1};

class WallScene {
 public:
  WallScene();

  const CameraModel& camera() const { return camera_; }
  const std::vector<Eigen::Vector3d>& points() const { return points_; }  // in the world

  // Of the points in the image, exact.
  std::vector<Feature> Features(const Rigid3& world_from_camera) const;
  // Nine keyframes along the wall; the fifth is described.
  Submap MakeSubmap(uint32_t sequence_number) const;
  std::vector<CorrectedKeyframe> Keyframes() const;
  // Of the first `count` points, from a view at the origin, after `first` others.
  LandmarkOffer MakeOffer(uint64_t view, size_t first, size_t count) const;

 private:
  static Rigid3 WorldFromKeyframe(int k);

  CameraModel camera_;
  std::vector<Eigen::Vector3d> points_;
  std::vector<Descriptor> descriptors_;
};

}  // namespace portolan

#endif  // PORTOLAN_TESTS_AGENT_REVISIT_WALL_SCENE_H_
