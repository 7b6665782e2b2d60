#include "agent/imu/imu_motion_model.h"

#include "common/linear_algebra/dense.h"

namespace portolan {
namespace {

double Square(double x) { return x * x; }

}  // namespace

Status ImuModelOptions::Validate() const {
  if (!(gravity_m_s2 > 9 && gravity_m_s2 < 10.5)) {
    return absl::InvalidArgumentError("imu.gravity_m_s2 must lie within 9 and 10.5");
  }
  if (!(noise_factor > 0 && gap_accel_density > 0 && gap_gyro_density > 0 && trusted_gap_s > 0)) {
    return absl::InvalidArgumentError("imu: every noise must be > 0");
  }
  return absl::OkStatus();
}

Eigen::Matrix3d FrameAlong(const Eigen::Vector3d& direction) {
  return RotationBetween(Eigen::Vector3d::UnitZ(), direction).normalized().toRotationMatrix();
}

ImuMotionModel::ImuMotionModel(const ImuModelOptions& options, const ImuCalibration& calibration,
                               const Rigid3& imu_from_camera, const ImuBuffer* samples)
    : MotionModel(imu_from_camera),
      options_(options),
      calibration_(calibration),
      samples_(samples),
      prior_covariance_(Eigen::MatrixXd::Identity(kDim - kVelocity, kDim - kVelocity)) {}

void ImuMotionModel::Set(Timestamp time, const Rigid3& submap_from_imu,
                         const InertialState& state) {
  SetPose(time, submap_from_imu);
  state_ = state;
}

void ImuMotionModel::SetPrior(const InertialState& state, const Eigen::MatrixXd& covariance) {
  prior_ = state;
  prior_covariance_ = covariance;
}

void ImuMotionModel::Start(Timestamp time, double, MotionMatrix* covariance) {
  ResetPose(time);
  state_ = prior_;
  bridged_s_ = gap_s_ = 0;
  covariance->setZero(kDim, kDim);
  covariance->bottomRightCorner(kDim - kVelocity, kDim - kVelocity) = prior_covariance_;
}

bool ImuMotionModel::Predict(Timestamp new_time, double, MotionMatrix* transition,
                             MotionMatrix* noise) {
  if (new_time <= time()) return false;
  Rigid3 pose = submap_from_body();
  StepMatrix total = StepMatrix::Identity(), noise_sum = StepMatrix::Zero();
  for (const ImuStep& step : samples_->Steps(time(), new_time)) {
    StepMatrix step_transition;
    Propagate(step, &pose, &step_transition, &noise_sum);
    SetToProduct(step_transition, StepMatrix(total), total);
    gap_s_ = step.measured ? 0 : gap_s_ + step.dt_s;
    if (!step.measured) bridged_s_ += step.dt_s;
  }
  SetPose(new_time, pose);
  *transition = total;
  *noise = 0.5 * (noise_sum + noise_sum.transpose());
  return true;
}

void ImuMotionModel::Propagate(const ImuStep& step, Rigid3* pose, StepMatrix* transition,
                               StepMatrix* noise) {
  const double dt = step.dt_s;
  const Eigen::Vector3d turn = (step.gyro_rad_s - state_.gyro_bias) * dt;
  // In a gap the body goes on at constant velocity.
  const Eigen::Vector3d force = step.accel_m_s2 - state_.accel_bias;
  const Eigen::Matrix3d half_turn = RotationExp(0.5 * turn).toRotationMatrix();
  const Eigen::Matrix3d middle = pose->rotation.toRotationMatrix() * half_turn;
  const Eigen::Vector3d gravity = options_.gravity_m_s2 * state_.gravity_direction();
  const double known = step.measured ? 1 : 0;
  const Eigen::Vector3d acceleration = known * (middle * force + gravity);

  // By the errors before the step.
  const Eigen::Matrix3d d_accel_d_middle = -known * middle * Skew(force);
  Eigen::Matrix<double, 3, kDim> d_accel = Eigen::Matrix<double, 3, kDim>::Zero();
  d_accel.block<3, 3>(0, kRotation) = d_accel_d_middle * half_turn.transpose();
  d_accel.block<3, 3>(0, kGyroBias) =
      -0.5 * dt * d_accel_d_middle * RotationRightJacobian(0.5 * turn);
  d_accel.block<3, 3>(0, kAccelBias) = -known * middle;
  d_accel.block<3, 2>(0, kGravity) =
      known * options_.gravity_m_s2 * state_.gravity_frame.leftCols<2>();
  StepMatrix& f = *transition;
  f.setIdentity();
  f.middleRows<3>(kPosition) += 0.5 * dt * dt * d_accel;
  f.block<3, 3>(kPosition, kVelocity).diagonal().array() += dt;
  f.middleRows<3>(kVelocity) += dt * d_accel;
  f.block<3, 3>(kRotation, kRotation) = RotationExp(turn).toRotationMatrix().transpose();
  f.block<3, 3>(kRotation, kGyroBias) = -dt * RotationRightJacobian(turn);

  pose->translation += dt * state_.velocity + 0.5 * dt * dt * acceleration;
  state_.velocity += dt * acceleration;
  pose->rotation = (pose->rotation * RotationExp(turn)).normalized();
  angular_velocity_in_camera_ =
      body_from_camera().rotation.conjugate() * (step.gyro_rad_s - state_.gyro_bias);

  // White noise, integrated over the step; the gyro's into the velocity through d_accel.
  const double factor = Square(options_.noise_factor);
  const double accel = step.measured ? factor * Square(calibration_.accelerometer_noise_density)
                                     : Square(options_.gap_accel_density);
  const double gyro = step.measured ? factor * Square(calibration_.gyroscope_noise_density)
                                    : Square(options_.gap_gyro_density);
  const double gyro_walk = factor * Square(calibration_.gyroscope_random_walk);
  const double accel_walk = factor * Square(calibration_.accelerometer_random_walk);
  StepMatrix half;
  SetToProduct(f, *noise, half);
  SetToProductTransposed(half, f, *noise);
  StepMatrix& q = *noise;
  const auto add = [&q](int row, int column, double value) {
    for (int i = 0; i < 3; ++i) q(row + i, column + i) += value;
  };
  add(kPosition, kPosition, accel * dt * dt * dt / 3);
  add(kPosition, kVelocity, accel * dt * dt / 2);
  add(kVelocity, kPosition, accel * dt * dt / 2);
  add(kVelocity, kVelocity, accel * dt);
  add(kRotation, kRotation, gyro * dt);
  const Eigen::Matrix3d velocity_rotation = 0.5 * gyro * dt * dt * d_accel_d_middle;
  q.block<3, 3>(kVelocity, kRotation) += velocity_rotation;
  q.block<3, 3>(kRotation, kVelocity) += velocity_rotation.transpose();
  add(kGyroBias, kGyroBias, gyro_walk * dt);
  add(kAccelBias, kAccelBias, accel_walk * dt);
}

void ImuMotionModel::CorrectRest(const Eigen::Ref<const Eigen::VectorXd>& error) {
  state_.velocity += error.segment<3>(kVelocity);
  state_.gyro_bias += error.segment<3>(kGyroBias);
  state_.accel_bias += error.segment<3>(kAccelBias);
  state_.gravity_frame =
      state_.gravity_frame *
      RotationExp({-error[kGravity + 1], error[kGravity], 0}).normalized().toRotationMatrix();
}

void ImuMotionModel::RebaseRest(MotionMatrix* d_new_d_old) {
  // x' = C'x for x velocity or gravity, C = R_imu Exp(e) R_ic: x' moves by [x']x R_ic' e.
  const Eigen::Matrix3d camera_from_imu =
      body_from_camera().rotation.conjugate().toRotationMatrix();
  const Eigen::Matrix3d new_from_old = submap_from_camera().rotation.toRotationMatrix().transpose();
  state_.velocity = new_from_old * state_.velocity;
  state_.gravity_frame = new_from_old * state_.gravity_frame;
  d_new_d_old->block<3, 3>(kVelocity, kVelocity) = new_from_old;
  d_new_d_old->block<3, 3>(kVelocity, kRotation) = Skew(state_.velocity) * camera_from_imu;
  d_new_d_old->block<6, 6>(kGyroBias, kGyroBias).setIdentity();
  d_new_d_old->block<2, 2>(kGravity, kGravity).setIdentity();
  // The frame's own columns turn along; only the part across gravity counts.
  d_new_d_old->block<2, 3>(kGravity, kRotation) = state_.gravity_frame.leftCols<2>().transpose() *
                                                  Skew(state_.gravity_direction()) *
                                                  camera_from_imu;
}

}  // namespace portolan
