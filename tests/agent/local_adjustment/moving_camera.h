// A camera that moves through a cloud of points, with exact pixels.
#ifndef PORTOLAN_TESTS_AGENT_LOCAL_ADJUSTMENT_MOVING_CAMERA_H_
#define PORTOLAN_TESTS_AGENT_LOCAL_ADJUSTMENT_MOVING_CAMERA_H_

#include <vector>

#include "agent/local_adjustment/local_adjustment.h"

namespace portolan {

inline constexpr int kFramesPerKeyframe = 3;

class MovingCamera {
 public:
  MovingCamera();

  const CameraModel& camera() const { return camera_; }
  static Timestamp Time(int frame) { return FromSeconds(0.04 * frame); }
  // Along a wall at a distance of 3 to 6, weaving and turning; that of frame 0 is the identity.
  static Rigid3 WorldFromCamera(int frame);
  // What frame sees; every fourth point is trusted.
  std::vector<LiveSight> Sights(int frame) const;
  // The same described; each point has a descriptor of its own.
  std::vector<Feature> Features(int frame) const;
  static Descriptor DescriptorOf(TrackId track);
  const std::vector<Eigen::Vector3d>& points() const { return points_; }

 private:
  CameraModel camera_;
  std::vector<Eigen::Vector3d> points_;
};

// Odometry whose unit of length shrinks by this share with every frame.
class DriftingOdometry {
 public:
  explicit DriftingOdometry(double drift) : drift_(drift) {}
  // Frames in order from 0.
  Rigid3 Next(int frame);

 private:
  double drift_;
  double scale_ = 1;
  Rigid3 odometry_from_camera_;
};

}  // namespace portolan

#endif  // PORTOLAN_TESTS_AGENT_LOCAL_ADJUSTMENT_MOVING_CAMERA_H_
