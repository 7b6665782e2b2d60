// Motion of a camera whose turns a gyro measures and whose velocity nothing does: the start of a
// visual-inertial filter, before scale and gravity are known.
#ifndef PORTOLAN_AGENT_IMU_GYRO_MOTION_MODEL_H_
#define PORTOLAN_AGENT_IMU_GYRO_MOTION_MODEL_H_

#include "agent/filter/constant_velocity_model.h"
#include "agent/imu/imu_motion_model.h"

namespace portolan {

// State: pose, linear velocity in the submap frame (constant but for white acceleration in scene
// depths, as ConstantVelocityModel's), gyro bias in the camera's axes. Error: [pose 6; velocity 3;
// bias 3], the latter two additive. The body is the camera. Not metric.
class GyroMotionModel : public MotionModel {
 public:
  static constexpr int kVelocity = 6, kBias = 9, kDim = 12;

  // `samples` outlives the model and holds the samples up to each Predict.
  GyroMotionModel(const ConstantVelocityOptions& motion, const ImuModelOptions& model,
                  double gyro_bias_sigma, const ImuCalibration& calibration,
                  const Eigen::Quaterniond& camera_from_imu, const ImuBuffer* samples);

  int error_dim() const override { return kDim; }
  void Start(Timestamp time, double scene_depth, MotionMatrix* covariance) override;
  bool Predict(Timestamp time, double scene_depth, MotionMatrix* transition,
               MotionMatrix* noise) override;
  void CorrectRest(const Eigen::Ref<const Eigen::VectorXd>& error) override;
  void RebaseRest(MotionMatrix* d_new_d_old) override;
  bool FillScaleDirection(Eigen::Ref<Eigen::VectorXd> direction) const override;
  Eigen::Vector3d linear_velocity() const override { return velocity_; }
  Eigen::Vector3d angular_velocity_rad_s() const override { return angular_velocity_; }
  const Eigen::Vector3d& gyro_bias() const { return bias_; }

 private:
  const ConstantVelocityOptions motion_;
  const ImuModelOptions model_;
  const double gyro_bias_sigma_;
  const ImuCalibration calibration_;
  const Eigen::Quaterniond camera_from_imu_;
  const ImuBuffer* const samples_;
  Eigen::Vector3d velocity_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d bias_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d angular_velocity_ = Eigen::Vector3d::Zero();
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_IMU_GYRO_MOTION_MODEL_H_
