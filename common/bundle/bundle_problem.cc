#include "common/bundle/bundle_problem.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace portolan {

BundleLens MakeLens(std::shared_ptr<const CameraModel> now, const CameraModel& nominal,
                    double corner_sigma_px, double readout_sigma_s) {
  BundleLens lens;
  const double right = nominal.width_px() - 1.0, bottom = nominal.height_px() - 1.0;
  double shift_px[2] = {0, 0};
  // A fisheye's corners may lie outside of its circle; the edges' middles do not, both of them.
  for (const Eigen::Vector2d& pixel :
       {Eigen::Vector2d(0, 0), Eigen::Vector2d(right, 0), Eigen::Vector2d(0, bottom),
        Eigen::Vector2d(right, bottom), Eigen::Vector2d(right, bottom / 2),
        Eigen::Vector2d(right / 2, bottom)}) {
    const auto bearing = nominal.Unproject(pixel);
    if (!bearing) continue;
    const Eigen::Matrix2d d_radial = nominal.DPixelDRadial(*bearing);
    for (int i = 0; i < 2; ++i) shift_px[i] = std::max(shift_px[i], d_radial.col(i).norm());
  }
  for (int i = 0; i < 2; ++i) {
    lens.sqrt_information(i, i) = std::max(shift_px[i], 1e-9) / corner_sigma_px;
    lens.deviation[i] = now->intrinsics().coefficients[i] - nominal.intrinsics().coefficients[i];
  }
  lens.sqrt_information(2, 2) = 1 / readout_sigma_s;
  lens.model = std::move(now);
  return lens;
}

double ReprojectionChi2(const BundleProblem& problem, const BundleObservation& observation) {
  const BundleCamera& camera = problem.cameras[observation.camera];
  const Rigid3& pose = camera.world_from_camera;
  const Eigen::Vector3d point_in_camera =
      pose.rotation.conjugate() *
      (problem.points[observation.point].point_in_world - pose.translation);
  const std::optional<Eigen::Vector2d> pixel = camera.model->Project(point_in_camera);
  if (!pixel) return std::numeric_limits<double>::infinity();
  return (*pixel - observation.pixel).squaredNorm() / (observation.sigma_px * observation.sigma_px);
}

double ParallaxRad(const std::vector<Eigen::Vector3d>& camera_positions,
                   const Eigen::Vector3d& point_in_world) {
  double largest = 0;
  if (camera_positions.empty()) return largest;
  const Eigen::Vector3d first = (point_in_world - camera_positions[0]).normalized();
  for (const Eigen::Vector3d& position : camera_positions) {
    const Eigen::Vector3d ray = (point_in_world - position).normalized();
    largest = std::max(largest, std::atan2(first.cross(ray).norm(), first.dot(ray)));
  }
  return largest;
}

double MedianDepth(const BundleProblem& problem) {
  std::vector<bool> seen(problem.points.size(), false);
  std::vector<double> depths;
  for (const BundleObservation& observation : problem.observations) {
    if (!observation.inlier || seen[observation.point]) continue;
    seen[observation.point] = true;
    depths.push_back((problem.points[observation.point].point_in_world -
                      problem.cameras[observation.camera].world_from_camera.translation)
                         .norm());
  }
  if (depths.empty()) return 1.0;
  std::nth_element(depths.begin(), depths.begin() + depths.size() / 2, depths.end());
  return std::max(depths[depths.size() / 2], 1e-9);
}

}  // namespace portolan
