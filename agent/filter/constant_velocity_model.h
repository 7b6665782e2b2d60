// Motion of a camera that nothing measures: constant linear and angular velocity, disturbed by
// white accelerations.
#ifndef PORTOLAN_AGENT_FILTER_CONSTANT_VELOCITY_MODEL_H_
#define PORTOLAN_AGENT_FILTER_CONSTANT_VELOCITY_MODEL_H_

#include "agent/filter/motion_model.h"
#include "common/base/status.h"

namespace portolan {

struct ConstantVelocityOptions {
  // Density of the white linear acceleration in scene depths, 1/s/sqrt(s): over a frame of dt
  // seconds the velocity wanders by this times sqrt(dt) median landmark distances a second.
  double linear_acceleration = 0.3;
  // Of the angular acceleration, rad/s/sqrt(s). At 30 Hz 1.2 gives 0.22 rad/s a frame, which a
  // hand-held camera reaches.
  double angular_acceleration = 1.2;
  // Spread of the unknown velocities at the start, in scene depths a second and rad/s. A car does
  // 0.5 scene depths a second; more sigma than needed lets the first frames of a resting camera
  // take turn for translation (measured with 0.1, 0.25, 0.4, 0.7).
  double initial_linear_velocity_sigma = 0.3;
  double initial_angular_velocity_sigma = 0.3;

  Status Validate() const;
};

// State: pose, linear velocity in the submap frame, angular velocity in the camera frame. Error:
// [pose 6; linear velocity 3; angular velocity 3], the latter two additive. The body is the
// camera. README.md, "Constant velocity".
class ConstantVelocityModel : public MotionModel {
 public:
  explicit ConstantVelocityModel(const ConstantVelocityOptions& options);

  int error_dim() const override { return 12; }
  void Start(Timestamp time, double scene_depth, MotionMatrix* covariance) override;
  bool Predict(Timestamp time, double scene_depth, MotionMatrix* transition,
               MotionMatrix* noise) override;
  void CorrectRest(const Eigen::Ref<const Eigen::VectorXd>& error) override;
  bool FillScaleDirection(Eigen::Ref<Eigen::VectorXd> direction) const override;
  void RebaseRest(MotionMatrix* d_new_d_old) override;
  std::unique_ptr<MotionModel> Clone() const override;
  std::unique_ptr<MotionModel> Rescaled(double scale, Eigen::VectorXd* factors) const override;
  void AddVelocity(const Eigen::Vector3d& linear, const Eigen::Vector3d& angular) override;
  Eigen::Vector3d linear_velocity() const override { return linear_velocity_; }
  Eigen::Vector3d angular_velocity_rad_s() const override { return angular_velocity_; }

 protected:
  void FillErrorOfRest(const MotionModel& other, Eigen::VectorXd* error) const override;

 private:
  const ConstantVelocityOptions options_;
  Eigen::Vector3d linear_velocity_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d angular_velocity_ = Eigen::Vector3d::Zero();
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_FILTER_CONSTANT_VELOCITY_MODEL_H_
