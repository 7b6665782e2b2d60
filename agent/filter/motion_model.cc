#include "agent/filter/motion_model.h"

namespace portolan {

MotionModel::MotionModel(const Rigid3& body_from_camera) : body_from_camera_(body_from_camera) {
  ResetPose(Timestamp{});
}

Rigid3 MotionModel::CorrectedCamera(const Vector6d& pose_error) const {
  Rigid3 corrected;
  corrected.translation = submap_from_body_.translation + pose_error.head<3>();
  corrected.rotation =
      (submap_from_body_.rotation * RotationExp(pose_error.tail<3>())).normalized();
  return corrected * body_from_camera_;
}

Matrix6d MotionModel::DCameraDPose() const {
  // p_c = p_b + R_b t, R_c = R_b R_bc with R_b Exp(e): p_c moves by -R_b [t]x e, R_c by R_bc' e.
  Matrix6d jacobian = Matrix6d::Identity();
  jacobian.topRightCorner<3, 3>() =
      -(submap_from_body_.rotation.toRotationMatrix() * Skew(body_from_camera_.translation));
  jacobian.bottomRightCorner<3, 3>() = body_from_camera_.rotation.toRotationMatrix().transpose();
  return jacobian;
}

Eigen::VectorXd MotionModel::ErrorOf(const MotionModel& other) const {
  Eigen::VectorXd error = Eigen::VectorXd::Zero(error_dim());
  error.head<3>() = other.submap_from_body_.translation - submap_from_body_.translation;
  error.segment<3>(3) =
      RotationLog(submap_from_body_.rotation.conjugate() * other.submap_from_body_.rotation);
  FillErrorOfRest(other, &error);
  return error;
}

void MotionModel::Correct(const Eigen::Ref<const Eigen::VectorXd>& error) {
  submap_from_body_.translation += error.head<3>();
  submap_from_body_.rotation =
      (submap_from_body_.rotation * RotationExp(error.segment<3>(3))).normalized();
  CorrectRest(error);
}

Rigid3 MotionModel::Rebase(MotionMatrix* d_new_d_old) {
  const Rigid3 old_from_new = submap_from_camera();
  d_new_d_old->setZero(error_dim(), error_dim());
  RebaseRest(d_new_d_old);
  submap_from_body_ = body_from_camera_.Inverse();
  return old_from_new;
}

void MotionModel::ResetPose(Timestamp time) { SetPose(time, body_from_camera_.Inverse()); }

void MotionModel::SetPose(Timestamp time, const Rigid3& submap_from_body) {
  time_ = time;
  submap_from_body_ = submap_from_body;
}

}  // namespace portolan
