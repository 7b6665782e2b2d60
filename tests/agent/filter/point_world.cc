#include "tests/agent/filter/point_world.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace portolan {
namespace {

CameraModel MakeCamera(const CameraIntrinsics& intrinsics) {
  return CameraModel::Create(intrinsics).value();
}

Eigen::Vector3d Gaussian(std::mt19937_64* random, double sigma) {
  std::normal_distribution<double> normal(0, sigma);
  const double x = normal(*random), y = normal(*random);
  return {x, y, normal(*random)};
}

}  // namespace

CameraModel MakeTestCamera() {
  CameraIntrinsics intrinsics;
  intrinsics.width_px = 640;
  intrinsics.height_px = 480;
  intrinsics.fx_px = intrinsics.fy_px = 525;
  intrinsics.cx_px = 320;
  intrinsics.cy_px = 240;
  intrinsics.distortion = DistortionModel::kRadTan;
  intrinsics.coefficients = {-0.1, 0.02, 1e-4, -1e-4, 0};
  return MakeCamera(intrinsics);
}

CameraModel MakeTestFisheye() {
  CameraIntrinsics intrinsics;
  intrinsics.width_px = 320;
  intrinsics.height_px = 240;
  intrinsics.fx_px = intrinsics.fy_px = 195;
  intrinsics.cx_px = 162;
  intrinsics.cy_px = 125;
  intrinsics.distortion = DistortionModel::kEquidistant;
  intrinsics.coefficients = {-0.009, -0.033, -0.005, 0.002, 0};
  return MakeCamera(intrinsics);
}

Trajectory SwayingTrajectory(double amplitude, double turn_rad, double period_s) {
  return [=](double t) {
    const double phase = 2 * std::numbers::pi * t / period_s;
    Rigid3 pose;
    // Each term starts with zero velocity.
    pose.translation =
        amplitude * Eigen::Vector3d(1 - std::cos(phase), 0.5 - 0.5 * std::cos(2 * phase),
                                    0.5 - 0.5 * std::cos(1.3 * phase));
    pose.rotation = RotationExp(turn_rad * Eigen::Vector3d(0.5 - 0.5 * std::cos(1.1 * phase),
                                                           std::cos(phase) - 1,
                                                           0.3 - 0.3 * std::cos(1.7 * phase)));
    return pose;
  };
}

Trajectory DrivingTrajectory(double speed, double turn_rate_rad_s) {
  return [=](double t) {
    const double angle = turn_rate_rad_s * t;
    Rigid3 pose;
    pose.rotation = RotationExp(Eigen::Vector3d(0, angle, 0));
    pose.translation =
        std::abs(turn_rate_rad_s) < 1e-9
            ? Eigen::Vector3d(0, 0, speed * t)
            : Eigen::Vector3d(speed / turn_rate_rad_s *
                              Eigen::Vector3d(1 - std::cos(angle), 0, std::sin(angle)));
    return pose;
  };
}

Trajectory RandomTrajectory(const ConstantVelocityOptions& options, double rate_hz,
                            double duration_s, uint64_t seed) {
  std::mt19937_64 random(seed);
  constexpr int kSubsteps = 20;
  const double dt = 1.0 / (rate_hz * kSubsteps);
  Eigen::Vector3d linear = Gaussian(&random, options.initial_linear_velocity_sigma);
  Eigen::Vector3d angular = Gaussian(&random, options.initial_angular_velocity_sigma);
  std::vector<Rigid3> poses(1);
  Rigid3 pose;
  for (int i = 1; i <= duration_s * rate_hz * kSubsteps + kSubsteps; ++i) {
    pose.translation += linear * dt;
    pose.rotation = (pose.rotation * RotationExp(angular * dt)).normalized();
    linear += Gaussian(&random, options.linear_acceleration * std::sqrt(dt));
    angular += Gaussian(&random, options.angular_acceleration * std::sqrt(dt));
    if (i % kSubsteps == 0) poses.push_back(pose);
  }
  return [poses, rate_hz](double t) { return poses.at(std::lround(t * rate_hz)); };
}

PointWorld::PointWorld(const PointWorldOptions& options, const CameraModel& camera,
                       Trajectory trajectory)
    : options_(options),
      camera_(camera),
      trajectory_(std::move(trajectory)),
      random_(options.seed),
      submap_from_world_(trajectory_(0).Inverse()) {}

void PointWorld::Start(LocalFilter* filter) {
  filter->Start(time());
  submap_from_world_ = world_from_camera().Inverse();
  Replenish(filter);
}

UpdateResult PointWorld::Step(LocalFilter* filter) {
  Advance();
  filter->Predict(time());
  const std::vector<Measurement> measurements = Measure(*filter);
  const UpdateResult result = filter->Update(measurements);
  Replenish(filter);
  return result;
}

std::vector<Measurement> PointWorld::Measure(const LocalFilter& filter) {
  std::normal_distribution<double> noise(0, true_sigma_px());
  std::uniform_real_distribution<double> uniform(0, 1);
  const Rigid3 camera_from_world = world_from_camera().Inverse();
  std::vector<Measurement> measurements;
  outliers_.clear();
  for (const Landmark& landmark : filter.state().landmarks()) {
    const auto pixel = camera_.Project(camera_from_world * points_in_world_.at(landmark.track));
    if (!pixel || !camera_.IsInImage(*pixel)) continue;
    Measurement measurement{landmark.track, *pixel, options_.pixel_sigma};
    measurement.pixel += Eigen::Vector2d(noise(random_), noise(random_));
    if (uniform(random_) < options_.outlier_share) {
      outliers_[landmark.track] = true;
      measurement.pixel = {uniform(random_) * camera_.width_px(),
                           uniform(random_) * camera_.height_px()};
    }
    measurements.push_back(measurement);
  }
  return measurements;
}

void PointWorld::Replenish(LocalFilter* filter) {
  const Rigid3 pose = world_from_camera();
  std::vector<TrackId> gone;
  for (const Landmark& landmark : filter->state().landmarks()) {
    const auto pixel = camera_.Project(pose.Inverse() * points_in_world_.at(landmark.track));
    if (!pixel || !camera_.IsInImage(*pixel)) gone.push_back(landmark.track);
  }
  filter->RemoveLandmarks(gone);

  std::normal_distribution<double> normal(0, 1);
  std::uniform_real_distribution<double> uniform(0, 1);
  const double mean = MedianTrueInverseDepth(*filter);
  std::vector<Measurement> added;
  while (filter->landmark_count() + static_cast<int>(added.size()) < options_.landmarks) {
    const Eigen::Vector2d pixel(uniform(random_) * (camera_.width_px() - 1),
                                uniform(random_) * (camera_.height_px() - 1));
    const auto bearing = camera_.Unproject(pixel);
    if (!bearing) continue;
    double inverse_depth = options_.depth ? 1.0 / options_.depth(pose, *bearing) : 0.0;
    while (!options_.depth && inverse_depth < options_.min_inverse_depth * mean) {
      inverse_depth = mean * (1 + options_.inverse_depth_sigma_ratio * normal(random_));
    }
    const TrackId track(next_track_++);
    points_in_world_[track] = pose * Eigen::Vector3d(*bearing / inverse_depth);
    const Eigen::Vector2d noise(normal(random_), normal(random_));
    added.push_back({track, pixel + true_sigma_px() * noise, options_.pixel_sigma});
  }
  filter->AddLandmarks(added);
}

double PointWorld::MedianTrueInverseDepth(const LocalFilter& filter) const {
  std::vector<double> values;
  for (const Landmark& landmark : filter.state().landmarks()) {
    const Eigen::Vector3d& point = points_in_world_.at(landmark.track);
    values.push_back(1.0 / (point - world_from_camera().translation).norm());
  }
  if (values.empty()) return 1;
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

void PointWorld::BeginSubmap(LocalFilter* filter) {
  filter->BeginSubmap();
  submap_from_world_ = world_from_camera().Inverse();
}

Rigid3 PointWorld::true_submap_from_camera() const {
  return submap_from_world_ * world_from_camera();
}

Eigen::Vector3d PointWorld::true_point_in_submap(TrackId track) const {
  return submap_from_world_ * points_in_world_.at(track);
}

}  // namespace portolan
