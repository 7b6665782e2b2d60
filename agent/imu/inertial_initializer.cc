#include "agent/imu/inertial_initializer.h"

#include <algorithm>
#include <string>
#include <unordered_map>
#include <utility>

#include "agent/filter/landmark.h"
#include "common/base/logging.h"
#include "common/linear_algebra/dense.h"

namespace portolan {
namespace {

constexpr int kPoseIterations = 6;
constexpr double kCauchyPx = 2.0;
// A landmark helps if its depth is known this well, relative.
constexpr double kMaxDepthSigma = 0.25;

}  // namespace

Status InertialInitializerOptions::Validate() const {
  PORTOLAN_RETURN_IF_ERROR(alignment.Validate());
  if (!(min_window_s > 0 && max_window_s >= min_window_s && attempt_interval_s > 0)) {
    return absl::InvalidArgumentError("imu: window and attempt_interval_s out of range");
  }
  if (!(patient_log_scale_sigma >= alignment.max_log_scale_sigma)) {
    return absl::InvalidArgumentError("imu.patient_log_scale_sigma is below max_log_scale_sigma");
  }
  if (min_landmarks < 4) return absl::InvalidArgumentError("imu.min_landmarks must be >= 4");
  return absl::OkStatus();
}

InertialInitializer::InertialInitializer(const InertialInitializerOptions& options,
                                         const ImuModelOptions& model,
                                         const ImuCalibration& calibration,
                                         const Rigid3& imu_from_camera, const CameraModel& camera,
                                         const ImuBuffer* samples)
    : options_(options),
      model_(model),
      calibration_(calibration),
      imu_from_camera_(imu_from_camera),
      camera_(camera),
      samples_(samples) {}

void InertialInitializer::Reset() {
  window_.clear();
  last_attempt_.reset();
}

void InertialInitializer::AddFrame(Timestamp time, const Rigid3& submap_from_camera,
                                   std::vector<Measurement> measurements) {
  window_.push_back({time, submap_from_camera, std::move(measurements)});
  while (ToSeconds(time - window_.front().time) > options_.max_window_s) window_.pop_front();
}

void InertialInitializer::Rebase(const Rigid3& old_from_new) {
  const Rigid3 new_from_old = old_from_new.Inverse();
  for (WindowFrame& frame : window_) {
    frame.submap_from_camera = new_from_old * frame.submap_from_camera;
  }
}

std::optional<InertialAlignment> InertialInitializer::Attempt(
    std::span<const LandmarkEstimate> landmarks, double scene_depth) {
  if (window_.empty()) return std::nullopt;
  const Timestamp now = window_.back().time;
  if (ToSeconds(now - window_.front().time) < options_.min_window_s) return std::nullopt;
  if (last_attempt_ && ToSeconds(now - *last_attempt_) < options_.attempt_interval_s) {
    return std::nullopt;
  }
  last_attempt_ = now;
  std::unordered_map<TrackId, Eigen::Vector3d> points;
  for (const LandmarkEstimate& landmark : landmarks) {
    if (landmark.inverse_depth_sigma < kMaxDepthSigma * landmark.inverse_depth) {
      points[landmark.track] = landmark.point_in_submap;
    }
  }
  std::vector<ScaleFreePose> poses;
  for (const WindowFrame& frame : window_) {
    std::vector<Eigen::Vector3d> known;
    std::vector<Eigen::Vector2d> pixels;
    for (const Measurement& measurement : frame.measurements) {
      const auto point = points.find(measurement.track);
      if (point == points.end()) continue;
      known.push_back(point->second);
      pixels.push_back(measurement.pixel);
    }
    const auto pose =
        RefineCameraPose(camera_, frame.submap_from_camera, known, pixels, options_.min_landmarks);
    if (pose) poses.push_back({frame.time, *pose});
  }
  if (poses.empty() || poses.back().time != now ||
      ToSeconds(now - poses.front().time) < options_.min_window_s) {
    return std::nullopt;
  }
  InertialAlignmentOptions needed = options_.alignment;
  const double length_s = ToSeconds(now - poses.front().time);
  if (length_s > options_.max_window_s - options_.attempt_interval_s) {
    needed.max_log_scale_sigma = options_.patient_log_scale_sigma;
  }
  std::string reason;
  auto alignment = AlignInertially(needed, model_, calibration_, imu_from_camera_, *samples_, poses,
                                   scene_depth, &reason);
  if (!alignment) {
    LogDebug("IMU not aligned yet: ", reason);
    return std::nullopt;
  }
  return alignment;
}

std::optional<Rigid3> RefineCameraPose(const CameraModel& camera, const Rigid3& submap_from_camera,
                                       std::span<const Eigen::Vector3d> points_in_submap,
                                       std::span<const Eigen::Vector2d> pixels, int min_points) {
  Rigid3 pose = submap_from_camera;
  Landmark landmark;
  landmark.euclidean = true;
  for (int iteration = 0; iteration < kPoseIterations; ++iteration) {
    Matrix6d h = Matrix6d::Zero();
    Vector6d b = Vector6d::Zero();
    int used = 0;
    for (size_t i = 0; i < points_in_submap.size(); ++i) {
      landmark.point_in_submap = points_in_submap[i];
      LandmarkProjection projection;
      if (!ProjectLandmark(landmark, Eigen::Vector3d::Zero(), pose, camera, &projection)) continue;
      const Eigen::Vector2d error = pixels[i] - projection.pixel;
      const double weight = 1 / (1 + error.squaredNorm() / (kCauchyPx * kCauchyPx));
      h += weight * projection.d_pixel_d_camera.transpose() * projection.d_pixel_d_camera;
      b += weight * projection.d_pixel_d_camera.transpose() * error;
      ++used;
    }
    if (used < min_points) return std::nullopt;
    Vector6d step = b;
    SolveSymmetric(h, step);
    if (!step.allFinite()) return std::nullopt;
    pose.translation += step.head<3>();
    pose.rotation = (pose.rotation * RotationExp(step.tail<3>())).normalized();
    if (step.norm() < 1e-8) break;
  }
  return pose;
}

MotionChange ChangeToInertial(const InertialAlignment& alignment, const Rigid3& submap_from_camera,
                              const Rigid3& imu_from_camera, int old_dim) {
  constexpr int kDim = ImuMotionModel::kDim;
  const Rigid3 camera_from_imu = imu_from_camera.Inverse();
  MotionChange change;
  change.scale = alignment.scale;
  change.d_new_d_old = Eigen::MatrixXd::Zero(kDim, old_dim);
  change.d_new_d_old.block<3, 3>(0, 0).diagonal().setConstant(alignment.scale);
  // p_imu = s p_c + R_c t_ci and R_imu = R_c R_ci, with R_c Exp(e).
  change.d_new_d_old.block<3, 3>(0, 3) =
      -submap_from_camera.rotation.toRotationMatrix() * Skew(camera_from_imu.translation);
  change.d_new_d_old.block<3, 3>(3, 3) = imu_from_camera.rotation.toRotationMatrix();
  change.d_new_d_added = Eigen::MatrixXd::Zero(kDim, InertialAlignment::kDim);
  change.d_new_d_added.col(0).head<3>() = alignment.scale * submap_from_camera.translation;
  change.d_new_d_added.bottomRightCorner(kDim - 6, kDim - 6).setIdentity();
  change.added_covariance = alignment.covariance;
  return change;
}

}  // namespace portolan
