// The replaceable part of the local filter that knows how the camera moves.
#ifndef PORTOLAN_AGENT_FILTER_MOTION_MODEL_H_
#define PORTOLAN_AGENT_FILTER_MOTION_MODEL_H_

#include <Eigen/Core>
#include <memory>
#include <optional>

#include "agent/image_source/samples.h"
#include "common/base/time.h"
#include "common/geometry/rigid3.h"

namespace portolan {

// Holds the nominal motion state (pose, velocities, biases, ...) and propagates it. The filter
// owns the covariance. The error state of every model starts with the six pose components
//   [position error in the submap frame; orientation error], submap_from_body (+) e:
//   position + e.head<3>(), rotation * Exp(e.tail<3>())                       (right perturbation)
// and goes on with what the model needs. The body is the IMU's or the vehicle's frame; without one
// it is the camera. Owned by one LocalFilter; thread-compatible.
class MotionModel {
 public:
  static constexpr int kPoseDim = 6;
  static constexpr int kMaxDim = 32;
  // Matrices of motion errors; no heap, since at most kMaxDim square.
  using MotionMatrix =
      Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kMaxDim, kMaxDim>;

  explicit MotionModel(const Rigid3& body_from_camera);
  virtual ~MotionModel() = default;

  virtual int error_dim() const = 0;
  // New unconnected submap whose frame is the camera at this instant: pose exactly known. Fills
  // the initial covariance. scene_depth: see Predict.
  virtual void Start(Timestamp time, double scene_depth, MotionMatrix* covariance) = 0;
  // Propagates the state to `time`; fills the transition F and the noise Q of the error:
  // e' = F e + w, w ~ N(0, Q). scene_depth is the median distance of the landmarks, the unit of
  // motion of a model without a metric sensor. False if time does not advance; state unchanged.
  virtual bool Predict(Timestamp time, double scene_depth, MotionMatrix* transition,
                       MotionMatrix* noise) = 0;
  // Adds an error to everything but the pose.
  virtual void CorrectRest(const Eigen::Ref<const Eigen::VectorXd>& error) = 0;
  // Turns everything but the pose into the frame of the current camera. Fills the rows of the
  // Jacobian of the new error by the old below the pose (the pose's rows are zero).
  virtual void RebaseRest(MotionMatrix* d_new_d_old) = 0;

  // A copy, for a smoother that keeps the states of several frames. Null if the model cannot be
  // smoothed.
  virtual std::unique_ptr<MotionModel> Clone() const { return nullptr; }
  // Adds to the velocities, in the frames of the accessors below. Only of models that Clone.
  virtual void AddVelocity(const Eigen::Vector3d&, const Eigen::Vector3d&) {}
  // The error e such that `other` is this one corrected by e. Only of models that Clone.
  Eigen::VectorXd ErrorOf(const MotionModel& other) const;

  // Fills the derivative of the motion errors by the logarithm of all inverse lengths. False, and
  // nothing filled, if the model's sensor measures lengths, so that the scale is not free.
  virtual bool FillScaleDirection(Eigen::Ref<Eigen::VectorXd>) const { return false; }

  // A copy in another unit of length, of which an old one holds `scale`, and the factors that its
  // errors take. Null if the model's sensor measures lengths.
  virtual std::unique_ptr<MotionModel> Rescaled(double, Eigen::VectorXd*) const { return nullptr; }

  // In the submap frame, units per second.
  virtual Eigen::Vector3d linear_velocity() const = 0;
  // In the camera frame.
  virtual Eigen::Vector3d angular_velocity_rad_s() const = 0;
  // Lengths are metres.
  virtual bool metric() const { return false; }
  // Unit vector downwards in the submap frame.
  virtual std::optional<Eigen::Vector3d> gravity_in_submap() const { return std::nullopt; }

  Timestamp time() const { return time_; }
  const Rigid3& submap_from_body() const { return submap_from_body_; }
  const Rigid3& body_from_camera() const { return body_from_camera_; }
  Rigid3 submap_from_camera() const { return submap_from_body_ * body_from_camera_; }
  // submap_from_camera if the pose error were added; the state is unchanged.
  Rigid3 CorrectedCamera(const Vector6d& pose_error) const;
  // Error of submap_from_camera, in the same convention, by the pose error.
  Matrix6d DCameraDPose() const;

  void Correct(const Eigen::Ref<const Eigen::VectorXd>& error);
  // The current camera becomes the submap frame. Returns old_submap_from_new_submap.
  Rigid3 Rebase(MotionMatrix* d_new_d_old);

 protected:
  // ErrorOf below the pose.
  virtual void FillErrorOfRest(const MotionModel&, Eigen::VectorXd*) const {}
  void ResetPose(Timestamp time);
  void SetPose(Timestamp time, const Rigid3& submap_from_body);

 private:
  Timestamp time_{};
  Rigid3 submap_from_body_;
  const Rigid3 body_from_camera_;
};

// A running filter that goes on with another motion model, e.g. because an IMU has told the scale.
// The new model holds its nominal state already, in new units.
struct MotionChange {
  // Length in new units of one old unit.
  double scale = 1;
  // New motion error by the old one.
  Eigen::MatrixXd d_new_d_old;
  // What the change adds: new motion error by quantities that are independent of the old errors,
  // and their covariance. The first is the logarithm of `scale`, which the landmarks share.
  Eigen::MatrixXd d_new_d_added;
  Eigen::MatrixXd added_covariance;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_FILTER_MOTION_MODEL_H_
