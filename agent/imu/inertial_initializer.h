// Finds scale, gravity, velocity and biases of a monocular filter that has just started.
#ifndef PORTOLAN_AGENT_IMU_INERTIAL_INITIALIZER_H_
#define PORTOLAN_AGENT_IMU_INERTIAL_INITIALIZER_H_

#include <deque>
#include <optional>
#include <span>
#include <vector>

#include "agent/filter/measurement.h"
#include "agent/imu/inertial_alignment.h"
#include "common/camera/camera_model.h"

namespace portolan {

struct InertialInitializerOptions {
  InertialAlignmentOptions alignment;
  // Shortest and longest stretch of frames that is aligned [s]. Short ones are tried first.
  double min_window_s = 1.0;
  double max_window_s = 4.0;
  // Once the longest window is full, less suffices than alignment.max_log_scale_sigma: the filter
  // learns the rest by and by.
  double patient_log_scale_sigma = 0.1;
  // Between two attempts [s]; one costs some milliseconds.
  double attempt_interval_s = 0.25;
  // Of a pose in the window.
  int min_landmarks = 8;

  Status Validate() const;
};

// While the camera-only filter runs, its frames are gathered. In an attempt all poses of the window
// are computed anew from the landmarks as the filter knows them now: its own poses of the first
// second were made while depths were unknown. Thread-compatible.
class InertialInitializer {
 public:
  // `samples` outlives this object.
  InertialInitializer(const InertialInitializerOptions& options, const ImuModelOptions& model,
                      const ImuCalibration& calibration, const Rigid3& imu_from_camera,
                      const CameraModel& camera, const ImuBuffer* samples);

  // Forgets the frames, and keeps the biases for the next time if they were found.
  void Reset();
  // The filter's pose and the inliers of a frame.
  void AddFrame(Timestamp time, const Rigid3& submap_from_camera,
                std::vector<Measurement> measurements);
  // The submap frame has changed.
  void Rebase(const Rigid3& old_from_new);
  // After AddFrame, if an attempt is due. scene_depth: see AlignInertially.
  std::optional<InertialAlignment> Attempt(std::span<const LandmarkEstimate> landmarks,
                                           double scene_depth);

 private:
  struct WindowFrame {
    Timestamp time{};
    Rigid3 submap_from_camera;
    std::vector<Measurement> measurements;
  };

  const InertialInitializerOptions options_;
  const ImuModelOptions model_;
  const ImuCalibration calibration_;
  const Rigid3 imu_from_camera_;
  const CameraModel camera_;
  const ImuBuffer* const samples_;
  std::deque<WindowFrame> window_;
  std::optional<Timestamp> last_attempt_;
};

// The camera's pose that explains the pixels of known points, from a start nearby; Gauss-Newton
// with Cauchy weights. No value if fewer than min_points project.
std::optional<Rigid3> RefineCameraPose(const CameraModel& camera, const Rigid3& submap_from_camera,
                                       std::span<const Eigen::Vector3d> points_in_submap,
                                       std::span<const Eigen::Vector2d> pixels, int min_points);

// How a camera-only filter at submap_from_camera (old units) goes on after an alignment:
// `old_dim` is the old model's error size.
MotionChange ChangeToInertial(const InertialAlignment& alignment, const Rigid3& submap_from_camera,
                              const Rigid3& imu_from_camera, int old_dim);

}  // namespace portolan

#endif  // PORTOLAN_AGENT_IMU_INERTIAL_INITIALIZER_H_
