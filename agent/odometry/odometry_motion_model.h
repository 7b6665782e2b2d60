// Motion of a vehicle whose wheels are counted: odometry increments propagate the pose.
#ifndef PORTOLAN_AGENT_ODOMETRY_ODOMETRY_MOTION_MODEL_H_
#define PORTOLAN_AGENT_ODOMETRY_ODOMETRY_MOTION_MODEL_H_

#include "agent/filter/motion_model.h"
#include "agent/odometry/odometry_buffer.h"
#include "common/base/status.h"

namespace portolan {

// Standard deviations grow with the square root of what they belong to.
struct OdometryModelOptions {
  double translation_per_sqrt_m = 0.02;   // m, along and across
  double rotation_per_sqrt_m = 0.01;      // rad: slip
  double rotation_per_sqrt_rad = 0.03;    // rad
  double out_of_plane_per_sqrt_m = 0.02;  // rad of roll and pitch, m of height: bumps
  double translation_per_sqrt_s = 0.002;  // at rest: play of the wheels, vibration
  double rotation_per_sqrt_s = 0.002;
  // Of the wheels' radius, relative; it is estimated.
  double scale_sigma = 0.03;
  // Where samples are missing: the last velocity goes on, with white accelerations.
  double gap_acceleration = 2.0;          // m/s/sqrt(s)
  double gap_angular_acceleration = 1.0;  // rad/s/sqrt(s)
  // After so long without samples lengths no longer count as metres [s].
  double trusted_gap_s = 3.0;

  Status Validate() const;
};

// Error: [pose 6; log scale of the odometry's lengths 1]. The body is the frame of the odometry.
//   position' = position + R s t          R' = R dR          with the increment (t, dR)
class OdometryMotionModel : public MotionModel {
 public:
  static constexpr int kScale = 6, kDim = 7;

  // `samples` outlives the model and holds the samples up to each Predict.
  OdometryMotionModel(const OdometryModelOptions& options, const Rigid3& body_from_camera,
                      const OdometryBuffer* samples);

  int error_dim() const override { return kDim; }
  void Start(Timestamp time, double scene_depth, MotionMatrix* covariance) override;
  bool Predict(Timestamp time, double scene_depth, MotionMatrix* transition,
               MotionMatrix* noise) override;
  void CorrectRest(const Eigen::Ref<const Eigen::VectorXd>& error) override;
  void RebaseRest(MotionMatrix* d_new_d_old) override;
  Eigen::Vector3d linear_velocity() const override;
  Eigen::Vector3d angular_velocity_rad_s() const override;
  bool metric() const override { return gap_s_ < options_.trusted_gap_s; }

  double scale() const { return scale_; }
  // Time without samples that Predict has bridged since the start [s].
  double bridged_s() const { return bridged_s_; }

 private:
  void FillNoise(const Rigid3& step, double dt, bool measured, MotionMatrix* noise) const;

  const OdometryModelOptions options_;
  const OdometryBuffer* const samples_;
  double scale_ = 1;
  // Mean over the last increment, in the body's frame at its end.
  Vector6d twist_ = Vector6d::Zero();
  double bridged_s_ = 0;
  double gap_s_ = 0;  // the present one's length so far
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_ODOMETRY_ODOMETRY_MOTION_MODEL_H_
