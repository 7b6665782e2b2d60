#include "agent/odometry/odometry_motion_model.h"

#include <cmath>

namespace portolan {
namespace {

double Square(double x) { return x * x; }

}  // namespace

Status OdometryModelOptions::Validate() const {
  for (const double value :
       {translation_per_sqrt_m, rotation_per_sqrt_m, rotation_per_sqrt_rad, out_of_plane_per_sqrt_m,
        translation_per_sqrt_s, rotation_per_sqrt_s, scale_sigma, gap_acceleration,
        gap_angular_acceleration, trusted_gap_s}) {
    if (!(value > 0))
      return absl::InvalidArgumentError("odometry: every noise and trusted_gap_s must be > 0");
  }
  return absl::OkStatus();
}

OdometryMotionModel::OdometryMotionModel(const OdometryModelOptions& options,
                                         const Rigid3& body_from_camera,
                                         const OdometryBuffer* samples)
    : MotionModel(body_from_camera), options_(options), samples_(samples) {}

void OdometryMotionModel::Start(Timestamp time, double, MotionMatrix* covariance) {
  ResetPose(time);
  scale_ = 1;
  twist_.setZero();
  bridged_s_ = gap_s_ = 0;
  covariance->setZero(kDim, kDim);
  (*covariance)(kScale, kScale) = Square(options_.scale_sigma);
}

bool OdometryMotionModel::Predict(Timestamp new_time, double, MotionMatrix* transition,
                                  MotionMatrix* noise) {
  const double dt = ToSeconds(new_time - time());
  if (dt <= 0) return false;
  const auto increment = samples_->Increment(time(), new_time);
  Rigid3 step;
  if (increment) {
    step = {increment->rotation, scale_ * increment->translation};
  } else {
    step = Rigid3::Exp(dt * twist_);
    bridged_s_ += dt;
    gap_s_ += dt;
  }
  const Eigen::Matrix3d rotation = submap_from_body().rotation.toRotationMatrix();
  transition->setIdentity(kDim, kDim);
  transition->block<3, 3>(0, 3) = -rotation * Skew(step.translation);
  transition->block<3, 3>(3, 3) = step.rotation.toRotationMatrix().transpose();
  if (increment) transition->block<3, 1>(0, kScale) = rotation * step.translation;
  FillNoise(step, dt, increment.has_value(), noise);
  SetPose(new_time, submap_from_body() * step);
  if (increment) {
    twist_ = step.Log() / dt;
    gap_s_ = 0;
  }
  return true;
}

// White in the body's frame at the end of the step.
void OdometryMotionModel::FillNoise(const Rigid3& step, double dt, bool measured,
                                    MotionMatrix* noise) const {
  const double way = step.translation.norm();
  const double turn = RotationLog(step.rotation).norm();
  const double bumps = Square(options_.out_of_plane_per_sqrt_m) * way;
  const double moving = Square(options_.translation_per_sqrt_m) * way;
  const double resting = Square(options_.translation_per_sqrt_s) * dt;
  const double turning = Square(options_.rotation_per_sqrt_m) * way +
                         Square(options_.rotation_per_sqrt_rad) * turn +
                         Square(options_.rotation_per_sqrt_s) * dt;
  Eigen::Vector3d translation = Eigen::Vector3d::Constant(moving + resting);
  translation.z() = bumps + resting;
  Eigen::Vector3d rotation = Eigen::Vector3d::Constant(turning);
  rotation.head<2>().array() += bumps;
  if (!measured) {
    translation.array() += Square(options_.gap_acceleration) * dt * dt * dt / 3;
    rotation.array() += Square(options_.gap_angular_acceleration) * dt * dt * dt / 3;
  }
  const Eigen::Matrix3d submap_from_end =
      (submap_from_body().rotation * step.rotation).toRotationMatrix();
  noise->setZero(kDim, kDim);
  noise->block<3, 3>(0, 0) =
      submap_from_end * translation.asDiagonal() * submap_from_end.transpose();
  noise->block<3, 3>(3, 3) = rotation.asDiagonal();
}

void OdometryMotionModel::CorrectRest(const Eigen::Ref<const Eigen::VectorXd>& error) {
  scale_ *= std::exp(error[kScale]);
}

void OdometryMotionModel::RebaseRest(MotionMatrix* d_new_d_old) {
  (*d_new_d_old)(kScale, kScale) = 1;
}

Eigen::Vector3d OdometryMotionModel::linear_velocity() const {
  return submap_from_body().rotation * twist_.head<3>();
}

Eigen::Vector3d OdometryMotionModel::angular_velocity_rad_s() const {
  return body_from_camera().rotation.conjugate() * twist_.tail<3>();
}

}  // namespace portolan
