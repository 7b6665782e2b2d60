// A camera that flies past points, without images: exact truth for the filter's tests.
#ifndef PORTOLAN_TESTS_AGENT_FILTER_POINT_WORLD_H_
#define PORTOLAN_TESTS_AGENT_FILTER_POINT_WORLD_H_

#include <cmath>
#include <functional>
#include <map>
#include <random>
#include <vector>

#include "agent/filter/constant_velocity_model.h"
#include "agent/filter/local_filter.h"

namespace portolan {

CameraModel MakeTestCamera();   // 640 x 480, 525 px, radial-tangential distortion
CameraModel MakeTestFisheye();  // 320 x 240, about 100 degrees

struct PointWorldOptions {
  double rate_hz = 30;
  double pixel_sigma = 1.0;
  // Error of the camera model, as white noise on top, which the measurements do not tell of.
  double model_sigma_px = 0.0;
  // Share of the matches that are replaced by a uniformly drawn pixel.
  double outlier_share = 0;
  // Landmarks kept in the filter.
  int landmarks = 40;
  // Inverse depth of a point that comes into view, about the median of those in the filter, as the
  // filter's own prior has it; drawn until it is above this share of the median.
  double inverse_depth_sigma_ratio = 0.5;
  double min_inverse_depth = 0.02;
  // If set, the points' depth in the camera instead (pixel -> distance), e.g. the walls of a room.
  std::function<double(const Rigid3& world_from_camera, const Eigen::Vector3d& bearing)> depth;
  uint64_t seed = 1;
};

// World from camera at a time in seconds.
using Trajectory = std::function<Rigid3(double time_s)>;

// Hand-held: sways about the start with amplitudes in units and radians, at rest at time 0.
Trajectory SwayingTrajectory(double amplitude, double turn_rad, double period_s);
// Straight ahead with a slow turn, units per second and rad/s.
Trajectory DrivingTrajectory(double speed, double turn_rate_rad_s);
// Drawn from the constant-velocity model itself.
Trajectory RandomTrajectory(const ConstantVelocityOptions& options, double rate_hz,
                            double duration_s, uint64_t seed);

// Feeds a filter frame by frame as its owner would: landmarks that leave the image are removed, new
// points appear at random pixels. The world's frame is the first submap's.
class PointWorld {
 public:
  PointWorld(const PointWorldOptions& options, const CameraModel& camera, Trajectory trajectory);

  // Starts the filter with the first points.
  void Start(LocalFilter* filter);
  // One frame: predict, measure, update, upkeep.
  UpdateResult Step(LocalFilter* filter);
  // Measurements of the filter's landmarks in the current frame, noise and outliers included.
  std::vector<Measurement> Measure(const LocalFilter& filter);
  void Advance() { ++frame_; }
  void Replenish(LocalFilter* filter);
  void BeginSubmap(LocalFilter* filter);

  double time_s() const { return frame_ / options_.rate_hz; }
  Timestamp time() const { return FromSeconds(time_s()); }
  Rigid3 true_submap_from_camera() const;
  Eigen::Vector3d true_point_in_submap(TrackId track) const;
  bool is_outlier(TrackId track) const { return outliers_.contains(track); }

 private:
  double MedianTrueInverseDepth(const LocalFilter& filter) const;
  double true_sigma_px() const { return std::hypot(options_.pixel_sigma, options_.model_sigma_px); }
  Rigid3 world_from_camera() const { return trajectory_(time_s()); }

  const PointWorldOptions options_;
  const CameraModel camera_;
  const Trajectory trajectory_;
  std::mt19937_64 random_;
  std::map<TrackId, Eigen::Vector3d> points_in_world_;
  std::map<TrackId, bool> outliers_;
  Rigid3 submap_from_world_;
  int frame_ = 0;
  uint32_t next_track_ = 1;
};

}  // namespace portolan

#endif  // PORTOLAN_TESTS_AGENT_FILTER_POINT_WORLD_H_
