#include "common/bundle/bundle_parameters.h"

#include <algorithm>

namespace portolan {

BundleParameters::BundleParameters(const BundleProblem& problem)
    : cameras(problem.cameras.size(), std::array<double, 6>{}),
      cameras_used(problem.cameras.size(), false),
      point_references(problem.points.size()),
      points(problem.points.size(), std::array<double, 3>{}),
      inliers(problem.points.size(), 0),
      median_depth(MedianDepth(problem)),
      lenses(problem.lenses.size(), LensVector::Zero()) {
  for (const BundleCamera& camera : problem.cameras) {
    camera_references.push_back({camera.world_from_camera, camera.model});
  }
  for (const BundleObservation& observation : problem.observations) {
    if (!observation.inlier || inliers[observation.point]++ > 0) continue;
    const Eigen::Vector3d& anchor =
        problem.cameras[observation.camera].world_from_camera.translation;
    const Eigen::Vector3d& point = problem.points[observation.point].point_in_world;
    point_references[observation.point] = PointReference::At(anchor, point);
    points[observation.point][2] = 1.0 / std::max((point - anchor).norm(), 1e-9);
  }
  for (const BundleObservation& observation : problem.observations) {
    if (HasSay(problem, observation)) cameras_used[observation.camera] = true;
  }
}

double BundleParameters::InverseDepthSigma(const BundleOptions& options, size_t point) const {
  return std::max(options.inverse_depth_prior_relative * points[point][2],
                  options.inverse_depth_prior_of_median / median_depth);
}

void BundleParameters::WriteTo(const BundleOptions& options, BundleProblem* problem) const {
  for (size_t i = 0; i < cameras.size(); ++i) {
    if (!cameras_used[i] || problem->cameras[i].fixed) continue;
    problem->cameras[i].world_from_camera = camera_references[i].Apply(cameras[i].data());
  }
  for (size_t i = 0; i < lenses.size(); ++i) {
    BundleLens& lens = problem->lenses[i];
    auto changed = lens.model->WithRadial(lenses[i].head<2>());
    if (!changed.ok()) continue;
    lens.model = std::make_shared<const CameraModel>(*std::move(changed));
    lens.deviation += lenses[i];
  }
  for (BundleCamera& camera : problem->cameras) {
    if (camera.lens >= 0) camera.model = problem->lenses[camera.lens].model.get();
  }
  const double min_rho = 1.0 / (options.max_depth_medians * median_depth);
  for (size_t i = 0; i < points.size(); ++i) {
    if (!IsAdjusted(*problem, i)) continue;
    problem->points[i].point_in_world = point_references[i].Apply(points[i].data(), min_rho);
  }
}

}  // namespace portolan
