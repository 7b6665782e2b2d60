// Motion of a body that carries an IMU: its samples propagate position, orientation and velocity.
#ifndef PORTOLAN_AGENT_IMU_IMU_MOTION_MODEL_H_
#define PORTOLAN_AGENT_IMU_IMU_MOTION_MODEL_H_

#include "agent/filter/motion_model.h"
#include "agent/imu/imu_buffer.h"
#include "common/base/status.h"
#include "common/camera/calibration.h"

namespace portolan {

struct ImuModelOptions {
  // Of the place; a thousandth covers the earth's surface but for the extremes.
  double gravity_m_s2 = 9.81;
  // Factor of all four densities of the calibration. Data sheets describe a sensor at rest;
  // vibration, scale errors and temperature come on top.
  double noise_factor = 2.0;
  // Where samples are missing: white acceleration [m/s^2/sqrt(Hz)] and rate [rad/s/sqrt(Hz)] about
  // the guess.
  double gap_accel_density = 4.0;
  double gap_gyro_density = 0.7;
  // After so long without samples lengths no longer count as metres: the camera alone keeps the
  // scale then, and it drifts [s].
  double trusted_gap_s = 3.0;

  Status Validate() const;
};

// Part of the state besides the pose.
struct InertialState {
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();  // submap frame, m/s
  Eigen::Vector3d gyro_bias = Eigen::Vector3d::Zero();
  Eigen::Vector3d accel_bias = Eigen::Vector3d::Zero();
  // The third column is the direction of gravity, downwards, in the submap frame.
  Eigen::Matrix3d gravity_frame = Eigen::Matrix3d::Identity();

  Eigen::Vector3d gravity_direction() const { return gravity_frame.col(2); }
};

// A frame whose third column is `direction`.
Eigen::Matrix3d FrameAlong(const Eigen::Vector3d& direction);

// Error: [pose 6; velocity 3; gyro bias 3; accel bias 3; gravity 2]. Velocity and biases are
// additive; gravity (a, b) turns its frame by Exp((-b, a, 0)), i.e. the direction by a towards
// column 0 and by b towards column 1. The body is the IMU. README.md gives the equations.
//
//   position' = velocity           velocity' = R (accel - b_a - n_a) + gravity
//   R' = R [gyro - b_g - n_g]x     biases: random walks
class ImuMotionModel : public MotionModel {
 public:
  static constexpr int kPosition = 0, kRotation = 3, kVelocity = 6, kGyroBias = 9, kAccelBias = 12,
                       kGravity = 15, kDim = 17;

  // `samples` outlives the model and holds the samples up to each Predict.
  ImuMotionModel(const ImuModelOptions& options, const ImuCalibration& calibration,
                 const Rigid3& imu_from_camera, const ImuBuffer* samples);

  // For a filter that has a pose already; the model then goes on from there.
  void Set(Timestamp time, const Rigid3& submap_from_imu, const InertialState& state);
  // What Start begins with, besides the exactly known pose; 11 x 11.
  void SetPrior(const InertialState& state, const Eigen::MatrixXd& covariance);

  int error_dim() const override { return kDim; }
  void Start(Timestamp time, double scene_depth, MotionMatrix* covariance) override;
  bool Predict(Timestamp time, double scene_depth, MotionMatrix* transition,
               MotionMatrix* noise) override;
  void CorrectRest(const Eigen::Ref<const Eigen::VectorXd>& error) override;
  void RebaseRest(MotionMatrix* d_new_d_old) override;
  // Of the IMU.
  Eigen::Vector3d linear_velocity() const override { return state_.velocity; }
  Eigen::Vector3d angular_velocity_rad_s() const override { return angular_velocity_in_camera_; }
  bool metric() const override { return gap_s_ < options_.trusted_gap_s; }
  std::optional<Eigen::Vector3d> gravity_in_submap() const override {
    return metric() ? std::optional(state_.gravity_direction()) : std::nullopt;
  }

  const InertialState& state() const { return state_; }
  // Time without samples that Predict has bridged since the start [s].
  double bridged_s() const { return bridged_s_; }

 private:
  using StepMatrix = Eigen::Matrix<double, kDim, kDim>;

  // One step of the mean; fills its transition and adds its noise.
  void Propagate(const ImuStep& step, Rigid3* pose, StepMatrix* transition, StepMatrix* noise);

  const ImuModelOptions options_;
  const ImuCalibration calibration_;
  const ImuBuffer* const samples_;
  InertialState state_;
  InertialState prior_;
  Eigen::MatrixXd prior_covariance_;
  Eigen::Vector3d angular_velocity_in_camera_ = Eigen::Vector3d::Zero();
  double bridged_s_ = 0;
  double gap_s_ = 0;  // the present one's length so far
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_IMU_IMU_MOTION_MODEL_H_
