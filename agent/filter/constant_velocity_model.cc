#include "agent/filter/constant_velocity_model.h"

namespace portolan {
namespace {

constexpr int kPosition = 0, kRotation = 3, kLinear = 6, kAngular = 9;

double Square(double x) { return x * x; }

}  // namespace

Status ConstantVelocityOptions::Validate() const {
  for (double value : {linear_acceleration, angular_acceleration, initial_linear_velocity_sigma,
                       initial_angular_velocity_sigma}) {
    if (!(value > 0)) {
      return absl::InvalidArgumentError("constant velocity: every noise must be > 0");
    }
  }
  return absl::OkStatus();
}

ConstantVelocityModel::ConstantVelocityModel(const ConstantVelocityOptions& options)
    : MotionModel(Rigid3::Identity()), options_(options) {}

void ConstantVelocityModel::Start(Timestamp time, double scene_depth, MotionMatrix* covariance) {
  ResetPose(time);
  linear_velocity_.setZero();
  angular_velocity_.setZero();
  covariance->setZero(error_dim(), error_dim());
  covariance->diagonal().segment<3>(kLinear).setConstant(
      Square(options_.initial_linear_velocity_sigma * scene_depth));
  covariance->diagonal().segment<3>(kAngular).setConstant(
      Square(options_.initial_angular_velocity_sigma));
}

bool ConstantVelocityModel::Predict(Timestamp new_time, double scene_depth,
                                    MotionMatrix* transition, MotionMatrix* noise) {
  const double dt = ToSeconds(new_time - time());
  if (dt <= 0) return false;
  const Eigen::Vector3d turn = angular_velocity_ * dt;
  const Eigen::Quaterniond delta = RotationExp(turn);
  Rigid3 pose = submap_from_body();
  pose.translation += linear_velocity_ * dt;
  pose.rotation = (pose.rotation * delta).normalized();
  SetPose(new_time, pose);

  const Eigen::Matrix3d d_rotation_d_angular = RotationRightJacobian(turn);
  transition->setIdentity(error_dim(), error_dim());
  transition->block<3, 3>(kPosition, kLinear).diagonal().setConstant(dt);
  transition->block<3, 3>(kRotation, kRotation) = delta.toRotationMatrix().transpose();
  transition->block<3, 3>(kRotation, kAngular) = d_rotation_d_angular * dt;

  // Integrated white acceleration: [dt^3/3, dt^2/2; dt^2/2, dt] for position and velocity.
  const double linear = Square(options_.linear_acceleration * scene_depth);
  const double angular = Square(options_.angular_acceleration);
  noise->setZero(error_dim(), error_dim());
  for (int i = 0; i < 3; ++i) {
    (*noise)(kPosition + i, kPosition + i) = linear * dt * dt * dt / 3;
    (*noise)(kPosition + i, kLinear + i) = linear * dt * dt / 2;
    (*noise)(kLinear + i, kPosition + i) = linear * dt * dt / 2;
    (*noise)(kLinear + i, kLinear + i) = linear * dt;
    (*noise)(kRotation + i, kRotation + i) = angular * dt * dt * dt / 3;
    (*noise)(kRotation + i, kAngular + i) = angular * dt * dt / 2;
    (*noise)(kAngular + i, kRotation + i) = angular * dt * dt / 2;
    (*noise)(kAngular + i, kAngular + i) = angular * dt;
  }
  return true;
}

void ConstantVelocityModel::CorrectRest(const Eigen::Ref<const Eigen::VectorXd>& error) {
  linear_velocity_ += error.segment<3>(kLinear);
  angular_velocity_ += error.segment<3>(kAngular);
}

std::unique_ptr<MotionModel> ConstantVelocityModel::Clone() const {
  return std::make_unique<ConstantVelocityModel>(*this);
}

std::unique_ptr<MotionModel> ConstantVelocityModel::Rescaled(double scale,
                                                             Eigen::VectorXd* factors) const {
  auto copy = std::make_unique<ConstantVelocityModel>(*this);
  copy->SetPose(time(), {submap_from_body().rotation, scale * submap_from_body().translation});
  copy->linear_velocity_ *= scale;
  factors->setOnes(error_dim());
  factors->segment<3>(kPosition).setConstant(scale);
  factors->segment<3>(kLinear).setConstant(scale);
  return copy;
}

void ConstantVelocityModel::AddVelocity(const Eigen::Vector3d& linear,
                                        const Eigen::Vector3d& angular) {
  linear_velocity_ += linear;
  angular_velocity_ += angular;
}

void ConstantVelocityModel::FillErrorOfRest(const MotionModel& other,
                                            Eigen::VectorXd* error) const {
  error->segment<3>(kLinear) = other.linear_velocity() - linear_velocity_;
  error->segment<3>(kAngular) = other.angular_velocity_rad_s() - angular_velocity_;
}

bool ConstantVelocityModel::FillScaleDirection(Eigen::Ref<Eigen::VectorXd> direction) const {
  direction.segment<3>(kPosition) = -submap_from_body().translation;
  direction.segment<3>(kLinear) = -linear_velocity_;
  return true;
}

void ConstantVelocityModel::RebaseRest(MotionMatrix* d_new_d_old) {
  // v' = R'v with R Exp(e): v' moves by [R'v]x e.
  const Eigen::Matrix3d new_from_old = submap_from_camera().rotation.toRotationMatrix().transpose();
  linear_velocity_ = new_from_old * linear_velocity_;
  d_new_d_old->block<3, 3>(kLinear, kLinear) = new_from_old;
  d_new_d_old->block<3, 3>(kLinear, kRotation) = Skew(linear_velocity_);
  d_new_d_old->block<3, 3>(kAngular, kAngular).setIdentity();
}

}  // namespace portolan
