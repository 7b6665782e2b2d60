#include "agent/imu/gyro_motion_model.h"

namespace portolan {
namespace {

constexpr int kPosition = 0, kRotation = 3;

double Square(double x) { return x * x; }

}  // namespace

GyroMotionModel::GyroMotionModel(const ConstantVelocityOptions& motion,
                                 const ImuModelOptions& model, double gyro_bias_sigma,
                                 const ImuCalibration& calibration,
                                 const Eigen::Quaterniond& camera_from_imu,
                                 const ImuBuffer* samples)
    : MotionModel(Rigid3::Identity()),
      motion_(motion),
      model_(model),
      gyro_bias_sigma_(gyro_bias_sigma),
      calibration_(calibration),
      camera_from_imu_(camera_from_imu),
      samples_(samples) {}

void GyroMotionModel::Start(Timestamp time, double scene_depth, MotionMatrix* covariance) {
  ResetPose(time);
  velocity_.setZero();
  bias_.setZero();
  covariance->setZero(kDim, kDim);
  covariance->diagonal().segment<3>(kVelocity).setConstant(
      Square(motion_.initial_linear_velocity_sigma * scene_depth));
  covariance->diagonal().segment<3>(kBias).setConstant(Square(gyro_bias_sigma_));
}

bool GyroMotionModel::Predict(Timestamp new_time, double scene_depth, MotionMatrix* transition,
                              MotionMatrix* noise) {
  const double dt = ToSeconds(new_time - time());
  if (dt <= 0) return false;
  Rigid3 pose = submap_from_body();
  pose.translation += dt * velocity_;
  Eigen::Matrix3d by_rotation = Eigen::Matrix3d::Identity();
  Eigen::Matrix3d by_bias = Eigen::Matrix3d::Zero();
  double angular = 0;
  for (const ImuStep& step : samples_->Steps(time(), new_time)) {
    angular_velocity_ = camera_from_imu_ * step.gyro_rad_s - bias_;
    const Eigen::Vector3d turn = step.dt_s * angular_velocity_;
    const Eigen::Quaterniond delta = RotationExp(turn);
    const Eigen::Matrix3d back = delta.toRotationMatrix().transpose();
    pose.rotation = (pose.rotation * delta).normalized();
    by_rotation = back * by_rotation;
    by_bias = back * by_bias - step.dt_s * RotationRightJacobian(turn);
    angular += step.dt_s * Square(step.measured
                                      ? model_.noise_factor * calibration_.gyroscope_noise_density
                                      : model_.gap_gyro_density);
  }
  SetPose(new_time, pose);
  transition->setIdentity(kDim, kDim);
  transition->block<3, 3>(kPosition, kVelocity).diagonal().setConstant(dt);
  transition->block<3, 3>(kRotation, kRotation) = by_rotation;
  transition->block<3, 3>(kRotation, kBias) = by_bias;
  const double linear = Square(motion_.linear_acceleration * scene_depth);
  const double walk = Square(model_.noise_factor * calibration_.gyroscope_random_walk);
  noise->setZero(kDim, kDim);
  for (int i = 0; i < 3; ++i) {
    (*noise)(kPosition + i, kPosition + i) = linear * dt * dt * dt / 3;
    (*noise)(kPosition + i, kVelocity + i) = linear * dt * dt / 2;
    (*noise)(kVelocity + i, kPosition + i) = linear * dt * dt / 2;
    (*noise)(kVelocity + i, kVelocity + i) = linear * dt;
    (*noise)(kRotation + i, kRotation + i) = angular;
    (*noise)(kBias + i, kBias + i) = walk * dt;
  }
  return true;
}

void GyroMotionModel::CorrectRest(const Eigen::Ref<const Eigen::VectorXd>& error) {
  velocity_ += error.segment<3>(kVelocity);
  bias_ += error.segment<3>(kBias);
}

void GyroMotionModel::RebaseRest(MotionMatrix* d_new_d_old) {
  // v' = R'v with R Exp(e): v' moves by [R'v]x e.
  const Eigen::Matrix3d new_from_old = submap_from_camera().rotation.toRotationMatrix().transpose();
  velocity_ = new_from_old * velocity_;
  d_new_d_old->block<3, 3>(kVelocity, kVelocity) = new_from_old;
  d_new_d_old->block<3, 3>(kVelocity, kRotation) = Skew(velocity_);
  d_new_d_old->block<3, 3>(kBias, kBias).setIdentity();
}

bool GyroMotionModel::FillScaleDirection(Eigen::Ref<Eigen::VectorXd> direction) const {
  direction.setZero();
  direction.segment<3>(kPosition) = -submap_from_body().translation;
  direction.segment<3>(kVelocity) = -velocity_;
  return true;
}

}  // namespace portolan
