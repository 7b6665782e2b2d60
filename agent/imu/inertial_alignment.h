// Scale, gravity, velocity and biases from a few seconds of IMU samples and camera poses of unknown
// scale.
#ifndef PORTOLAN_AGENT_IMU_INERTIAL_ALIGNMENT_H_
#define PORTOLAN_AGENT_IMU_INERTIAL_ALIGNMENT_H_

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "agent/imu/imu_motion_model.h"

namespace portolan {

struct InertialAlignmentOptions {
  // Errors of the camera poses: position over the scene's depth, orientation [rad]. Neighbouring
  // poses share errors; if the fit is worse than this, all covariances grow with it.
  double position_sigma_of_depth = 0.003;
  double rotation_sigma_rad = 0.003;
  // What is known about the biases beforehand [rad/s, m/s^2].
  double gyro_bias_sigma = 0.1;
  double accel_bias_sigma = 0.2;
  // Observability: the scale's standard deviation (log) and gravity's [rad] that are good enough.
  double max_log_scale_sigma = 0.03;
  double max_gravity_sigma_rad = 0.1;

  Status Validate() const;
};

// A pose of the camera up to scale; all of a window in one frame.
struct ScaleFreePose {
  Timestamp time{};
  Rigid3 submap_from_camera;
};

struct InertialAlignment {
  // [log scale; velocity 3; gyro bias 3; accel bias 3; gravity 2] as in ImuMotionModel.
  static constexpr int kDim = 12;

  double scale = 1;     // metres a submap unit
  InertialState state;  // at the last pose; the submap's axes, metres
  Eigen::Matrix<double, kDim, kDim> covariance;
  // Squared error of the fit over its degrees of freedom; 1 if the options' sigmas hold.
  double normalised_error = 1;
};

// The closed form of Martinelli ("Closed-form solution of visual-inertial structure from motion",
// IJCV 2014, Sec. 3) as Qin, Li, Shen state it for known camera poses ("VINS-Mono", T-RO 2018,
// Sec. V-B): first the gyro bias from the turns, then scale, velocity, gravity and accel bias
// linearly from the positions,
//   s p_k + R_k t = p_0 + v_0 t_k + g t_k^2 / 2 + R_0 alpha_k,
// then all of it with |g| known by Gauss-Newton. No value, with the reason, while the motion does
// not tell the scale. scene_depth: median distance of the landmarks in submap units.
std::optional<InertialAlignment> AlignInertially(
    const InertialAlignmentOptions& options, const ImuModelOptions& model,
    const ImuCalibration& calibration, const Rigid3& imu_from_camera, const ImuBuffer& samples,
    const std::vector<ScaleFreePose>& poses, double scene_depth, std::string* reason);

// Integral of the samples since the first pose, in the body's frame there, with its derivatives by
// the biases (Forster, Carlone, Dellaert, Scaramuzza, "On-manifold preintegration", T-RO 2017).
struct ImuIncrement {
  double time_s = 0;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  // alpha
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();  // beta
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Matrix3d d_position_d_gyro = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d d_position_d_accel = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d d_velocity_d_gyro = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d d_velocity_d_accel = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d d_rotation_d_gyro = Eigen::Matrix3d::Zero();  // right perturbation

  void Add(const ImuStep& step, const Eigen::Vector3d& gyro_bias,
           const Eigen::Vector3d& accel_bias);
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_IMU_INERTIAL_ALIGNMENT_H_
