#include "agent/imu/inertial_alignment.h"

#include <algorithm>
#include <cmath>

#include "common/base/concat.h"
#include "common/linear_algebra/dense.h"

namespace portolan {
namespace {

constexpr int kIterations = 15;
// Unknowns of the final fit: scale and first velocity, biases, gravity, and the first pose's error.
constexpr int kLogScale = 0, kVelocity = 1, kGyro = 4, kAccel = 7, kGravity = 10, kTurn = 12,
              kShift = 15, kUnknowns = 18;
using UnknownMatrix = Eigen::Matrix<double, kUnknowns, kUnknowns>;
using UnknownVector = Eigen::Matrix<double, kUnknowns, 1>;
using Row3 = Eigen::Matrix<double, 3, kUnknowns>;

double Square(double x) { return x * x; }

class Alignment {
 public:
  Alignment(const InertialAlignmentOptions& options, const ImuModelOptions& model,
            const ImuCalibration& calibration, const Rigid3& imu_from_camera,
            const ImuBuffer& samples, const std::vector<ScaleFreePose>& poses, double scene_depth)
      : options_(options),
        model_(model),
        calibration_(calibration),
        camera_from_imu_(imu_from_camera.Inverse()),
        poses_(poses),
        scene_depth_(scene_depth) {
    for (size_t k = 1; k < poses.size(); ++k) {
      steps_.push_back(samples.Steps(poses[k - 1].time, poses[k].time));
    }
    first_rotation_ = ImuRotation(0);
  }

  bool IsMeasured() const {
    return std::all_of(steps_.begin(), steps_.end(), [](const auto& steps) {
      return std::all_of(steps.begin(), steps.end(),
                         [](const ImuStep& step) { return step.measured; });
    });
  }

  void FitGyroBias() {
    for (int i = 0; i < 3; ++i) {
      Integrate();
      Eigen::Matrix3d h = Eigen::Matrix3d::Identity() *
                          Square(options_.rotation_sigma_rad / options_.gyro_bias_sigma);
      Eigen::Vector3d b = -h * gyro_bias_;
      for (size_t k = 1; k < poses_.size(); ++k) {
        const ImuIncrement& increment = increments_[k];
        const Eigen::Vector3d error = RotationLog(increment.rotation.conjugate() *
                                                  first_rotation_.conjugate() * ImuRotation(k));
        h += increment.d_rotation_d_gyro.transpose() * increment.d_rotation_d_gyro;
        b += increment.d_rotation_d_gyro.transpose() * error;
      }
      SolveSymmetric(h, b);
      gyro_bias_ += b;
    }
    Integrate();
  }

  // Scale, first velocity, gravity as any vector, accel bias. False if the scale is not positive or
  // gravity not near the known size.
  bool FitLinearly(std::string* reason) {
    Eigen::Matrix<double, 10, 10> h = Eigen::Matrix<double, 10, 10>::Zero();
    Eigen::Matrix<double, 10, 1> b = Eigen::Matrix<double, 10, 1>::Zero();
    const Eigen::Matrix3d r0 = first_rotation_.toRotationMatrix();
    for (size_t k = 1; k < poses_.size(); ++k) {
      const ImuIncrement& increment = increments_[k];
      const double t = increment.time_s;
      Eigen::Matrix<double, 3, 10> row;
      row.col(0) =
          poses_[k].submap_from_camera.translation - poses_[0].submap_from_camera.translation;
      row.middleCols<3>(1) = -t * Eigen::Matrix3d::Identity();
      row.middleCols<3>(4) = -0.5 * t * t * Eigen::Matrix3d::Identity();
      row.middleCols<3>(7) = -r0 * increment.d_position_d_accel;
      const Eigen::Vector3d value = r0 * increment.position - LeverArm(k) + LeverArm(0);
      AddTransposedProduct(1, row, row, h);
      AddTransposedProduct(1, row, value, b);
    }
    const double sigma = std::max(options_.position_sigma_of_depth * scene_depth_, 1e-4);
    h.diagonal().tail<3>().array() += Square(sigma / options_.accel_bias_sigma);
    Eigen::Matrix<double, 10, 1> x = b;
    SolveSymmetric(h, x);
    const Eigen::Vector3d gravity = x.segment<3>(4);
    if (!x.allFinite() || !(x[0] > 0)) {
      *reason = Concat("the scale comes out as ", x[0]);
      return false;
    }
    if (std::abs(gravity.norm() - model_.gravity_m_s2) > 0.25 * model_.gravity_m_s2) {
      *reason = Concat("gravity comes out as ", gravity.norm(), " m/s^2");
      return false;
    }
    scale_ = x[0];
    first_velocity_ = x.segment<3>(1);
    gravity_frame_ = FrameAlong(gravity.normalized());
    accel_bias_ = x.segment<3>(7);
    return true;
  }

  bool FitFully(std::string* reason) {
    for (int i = 0; i < kIterations; ++i) {
      Integrate();
      UnknownVector b;
      const double error = BuildNormalEquations(&b);
      UnknownVector x = b;
      if (!SolveSymmetric(information_, x) || !x.allFinite() || std::abs(x[kLogScale]) > 3) {
        *reason = "the fit fails";
        return false;
      }
      const double dof = 6.0 * static_cast<double>(poses_.size() - 1) - 14;
      normalised_error_ = dof > 0 ? error / dof : error;
      Correct(x);
      if (x.cwiseAbs().maxCoeff() < 1e-6) break;
    }
    Integrate();
    return true;
  }

  InertialAlignment Result() const {
    const ImuIncrement& last = increments_.back();
    const Eigen::Matrix3d r0 = first_rotation_.toRotationMatrix();
    InertialAlignment result;
    result.scale = scale_;
    result.state.gyro_bias = gyro_bias_;
    result.state.accel_bias = accel_bias_;
    result.state.gravity_frame = gravity_frame_;
    result.state.velocity = first_velocity_ + last.time_s * Gravity() + r0 * last.velocity;
    Eigen::Matrix<double, InertialAlignment::kDim, kUnknowns> d =
        Eigen::Matrix<double, InertialAlignment::kDim, kUnknowns>::Identity();
    d.block<3, 3>(1, kGyro) = r0 * last.d_velocity_d_gyro;
    d.block<3, 3>(1, kAccel) = r0 * last.d_velocity_d_accel;
    d.block<3, 2>(1, kGravity) = last.time_s * model_.gravity_m_s2 * gravity_frame_.leftCols<2>();
    d.block<3, 3>(1, kTurn) = -r0 * Skew(last.velocity);
    UnknownMatrix covariance = UnknownMatrix::Identity();
    SolveSymmetric(information_, covariance);
    result.covariance = Congruence(d, covariance) * std::max(1.0, normalised_error_);
    // What the samples' noise and the walk of the biases did meanwhile.
    const double factor = Square(model_.noise_factor) * last.time_s;
    result.covariance.diagonal().segment<3>(1).array() +=
        factor * Square(calibration_.accelerometer_noise_density);
    result.covariance.diagonal().segment<3>(4).array() +=
        factor * Square(calibration_.gyroscope_random_walk);
    result.covariance.diagonal().segment<3>(7).array() +=
        factor * Square(calibration_.accelerometer_random_walk);
    result.normalised_error = normalised_error_;
    return result;
  }

 private:
  Eigen::Quaterniond ImuRotation(size_t k) const {
    return poses_[k].submap_from_camera.rotation * camera_from_imu_.rotation;
  }
  // From the camera to the IMU, metres, in the submap's axes.
  Eigen::Vector3d LeverArm(size_t k) const {
    return poses_[k].submap_from_camera.rotation * camera_from_imu_.translation;
  }
  Eigen::Vector3d Gravity() const { return model_.gravity_m_s2 * gravity_frame_.col(2); }

  void Integrate() {
    increments_.assign(1, ImuIncrement());
    for (const auto& steps : steps_) {
      increments_.push_back(increments_.back());
      for (const ImuStep& step : steps) increments_.back().Add(step, gyro_bias_, accel_bias_);
    }
  }

  // Fills information_; returns the squared error of the poses.
  double BuildNormalEquations(UnknownVector* b) {
    information_.setZero();
    b->setZero();
    AddPriors(b);
    const Eigen::Vector3d p0 =
        scale_ * poses_[0].submap_from_camera.translation + LeverArm(0) + first_shift_;
    const Eigen::Matrix3d r0 = first_rotation_.toRotationMatrix();
    double sum = 0;
    for (size_t k = 1; k < poses_.size(); ++k) {
      const ImuIncrement& increment = increments_[k];
      const double t = increment.time_s;
      const Eigen::Vector3d camera =
          poses_[k].submap_from_camera.translation - poses_[0].submap_from_camera.translation;
      const Eigen::Vector3d position_error =
          p0 + t * first_velocity_ + 0.5 * t * t * Gravity() + r0 * increment.position -
          scale_ * poses_[k].submap_from_camera.translation - LeverArm(k);
      Row3 row = Row3::Zero();
      row.col(kLogScale) = -scale_ * camera;
      row.middleCols<3>(kVelocity).diagonal().setConstant(t);
      row.middleCols<3>(kGyro) = r0 * increment.d_position_d_gyro;
      row.middleCols<3>(kAccel) = r0 * increment.d_position_d_accel;
      row.middleCols<2>(kGravity) =
          0.5 * t * t * model_.gravity_m_s2 * gravity_frame_.leftCols<2>();
      row.middleCols<3>(kTurn) = -r0 * Skew(increment.position);
      row.middleCols<3>(kShift).setIdentity();
      sum += Add(row, position_error, PositionVariance(t), b);

      const Eigen::Quaterniond predicted = first_rotation_ * increment.rotation;
      Row3 turn = Row3::Zero();
      turn.middleCols<3>(kGyro) = increment.d_rotation_d_gyro;
      turn.middleCols<3>(kTurn) = increment.rotation.toRotationMatrix().transpose();
      sum += Add(turn, RotationLog(ImuRotation(k).conjugate() * predicted), RotationVariance(t), b);
    }
    return sum;
  }

  double Add(const Row3& row, const Eigen::Vector3d& error, double variance, UnknownVector* b) {
    AddTransposedProduct(1 / variance, row, row, information_);
    AddTransposedProduct(-1 / variance, row, error, *b);
    return error.squaredNorm() / variance;
  }

  void AddPriors(UnknownVector* b) {
    const auto add = [&](int first, const Eigen::Vector3d& value, double sigma) {
      information_.diagonal().segment<3>(first).array() += 1 / Square(sigma);
      b->segment<3>(first) -= value / Square(sigma);
    };
    add(kGyro, gyro_bias_, options_.gyro_bias_sigma);
    add(kAccel, accel_bias_, options_.accel_bias_sigma);
    add(kTurn, RotationLog(ImuRotation(0).conjugate() * first_rotation_),
        options_.rotation_sigma_rad);
    add(kShift, first_shift_, PositionSigma());
  }

  double PositionSigma() const {
    return std::max(options_.position_sigma_of_depth * scene_depth_ * scale_, 1e-4);
  }
  // With what the IMU's noise adds over the time.
  double PositionVariance(double t) const {
    const double accel = model_.noise_factor * calibration_.accelerometer_noise_density;
    const double gyro =
        model_.noise_factor * calibration_.gyroscope_noise_density * model_.gravity_m_s2;
    return Square(PositionSigma()) + Square(accel) * t * t * t / 3 +
           Square(gyro) * std::pow(t, 5) / 20;
  }
  double RotationVariance(double t) const {
    return Square(options_.rotation_sigma_rad) +
           Square(model_.noise_factor * calibration_.gyroscope_noise_density) * t;
  }

  void Correct(const UnknownVector& x) {
    scale_ *= std::exp(x[kLogScale]);
    first_velocity_ += x.segment<3>(kVelocity);
    gyro_bias_ += x.segment<3>(kGyro);
    accel_bias_ += x.segment<3>(kAccel);
    gravity_frame_ =
        gravity_frame_ * RotationExp({-x[kGravity + 1], x[kGravity], 0}).toRotationMatrix();
    first_rotation_ = (first_rotation_ * RotationExp(x.segment<3>(kTurn))).normalized();
    first_shift_ += x.segment<3>(kShift);
  }

  const InertialAlignmentOptions& options_;
  const ImuModelOptions& model_;
  const ImuCalibration& calibration_;
  const Rigid3 camera_from_imu_;
  const std::vector<ScaleFreePose>& poses_;
  const double scene_depth_;
  std::vector<std::vector<ImuStep>> steps_;
  std::vector<ImuIncrement> increments_;  // parallel to the poses
  double scale_ = 1;
  Eigen::Vector3d first_velocity_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d gyro_bias_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d accel_bias_ = Eigen::Vector3d::Zero();
  Eigen::Matrix3d gravity_frame_ = Eigen::Matrix3d::Identity();
  Eigen::Quaterniond first_rotation_;
  Eigen::Vector3d first_shift_ = Eigen::Vector3d::Zero();
  UnknownMatrix information_;
  double normalised_error_ = 1;
};

}  // namespace

Status InertialAlignmentOptions::Validate() const {
  if (!(position_sigma_of_depth > 0 && rotation_sigma_rad > 0 && gyro_bias_sigma > 0 &&
        accel_bias_sigma > 0 && max_log_scale_sigma > 0 && max_gravity_sigma_rad > 0)) {
    return absl::InvalidArgumentError("imu alignment: every sigma must be > 0");
  }
  return absl::OkStatus();
}

void ImuIncrement::Add(const ImuStep& step, const Eigen::Vector3d& gyro_bias,
                       const Eigen::Vector3d& accel_bias) {
  const double dt = step.dt_s;
  const Eigen::Vector3d turn = (step.gyro_rad_s - gyro_bias) * dt;
  const Eigen::Vector3d force = step.accel_m_s2 - accel_bias;
  const Eigen::Matrix3d half_turn = RotationExp(0.5 * turn).toRotationMatrix();
  const Eigen::Matrix3d middle = rotation.toRotationMatrix() * half_turn;
  const Eigen::Vector3d acceleration = middle * force;
  const Eigen::Matrix3d d_accel_d_gyro =
      -middle * Skew(force) *
      (half_turn.transpose() * d_rotation_d_gyro - 0.5 * dt * RotationRightJacobian(0.5 * turn));
  position += dt * velocity + 0.5 * dt * dt * acceleration;
  velocity += dt * acceleration;
  d_position_d_gyro += dt * d_velocity_d_gyro + 0.5 * dt * dt * d_accel_d_gyro;
  d_position_d_accel += dt * d_velocity_d_accel - 0.5 * dt * dt * middle;
  d_velocity_d_gyro += dt * d_accel_d_gyro;
  d_velocity_d_accel -= dt * middle;
  const Eigen::Quaterniond delta = RotationExp(turn);
  rotation = (rotation * delta).normalized();
  d_rotation_d_gyro =
      delta.toRotationMatrix().transpose() * d_rotation_d_gyro - dt * RotationRightJacobian(turn);
  time_s += dt;
}

std::optional<InertialAlignment> AlignInertially(
    const InertialAlignmentOptions& options, const ImuModelOptions& model,
    const ImuCalibration& calibration, const Rigid3& imu_from_camera, const ImuBuffer& samples,
    const std::vector<ScaleFreePose>& poses, double scene_depth, std::string* reason) {
  if (poses.size() < 6) {
    *reason = "too few poses";
    return std::nullopt;
  }
  Alignment alignment(options, model, calibration, imu_from_camera, samples, poses, scene_depth);
  if (!alignment.IsMeasured()) {
    *reason = "samples are missing";
    return std::nullopt;
  }
  alignment.FitGyroBias();
  if (!alignment.FitLinearly(reason) || !alignment.FitFully(reason)) return std::nullopt;
  const InertialAlignment result = alignment.Result();
  const double scale_sigma = std::sqrt(result.covariance(0, 0));
  const double gravity_sigma = std::sqrt(result.covariance.bottomRightCorner<2, 2>().trace());
  if (!result.covariance.allFinite() || !(scale_sigma < options.max_log_scale_sigma) ||
      !(gravity_sigma < options.max_gravity_sigma_rad)) {
    *reason = Concat("the motion tells the scale within ", 100 * scale_sigma,
                     " % and gravity within ", gravity_sigma, " rad only");
    return std::nullopt;
  }
  return result;
}

}  // namespace portolan
