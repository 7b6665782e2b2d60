#include "server/refinement/backward_start.h"

#include "common/bundle/resection.h"

namespace portolan {
namespace {

// The filter's motion over the last so many serves where too few of its points are seen.
constexpr size_t kTrustedCameras = 4;
// From the pose of the next keyframe it may be far.
constexpr int kIterations = 15;

class BackwardStart {
 public:
  BackwardStart(const BundleProblem& problem,
                const std::vector<std::optional<Eigen::Vector3d>>& known,
                const BundleOptions& bundle, const TriangulationOptions& triangulation,
                double scene_depth)
      : problem_(problem),
        from_filter_(known),
        points_(known),
        triangulation_(triangulation),
        scene_depth_(scene_depth),
        observations_of_(problem.cameras.size()) {
    resection_.max_iterations = kIterations;
    resection_.loss_scale_sigmas = bundle.loss_scale_sigmas;
    resection_.outlier_chi2 = bundle.outlier_chi2;
    for (const BundleCamera& camera : problem.cameras) poses_.push_back(camera.world_from_camera);
    for (size_t i = 0; i < problem.observations.size(); ++i) {
      observations_of_[problem.observations[i].camera].push_back(i);
    }
    first_observation_of_.assign(problem.points.size() + 1, problem.observations.size());
    for (size_t i = problem.observations.size(); i-- > 0;) {
      first_observation_of_[problem.observations[i].point] = i;
    }
  }

  std::optional<std::vector<Rigid3>> Run() {
    for (size_t k = poses_.size(); k-- > 0;) {
      if (k + 1 < poses_.size() && !Place(k)) return std::nullopt;
      TriangulateSeenBy(k);
    }
    const Rigid3 first_from_start = poses_.front().Inverse();
    for (Rigid3& pose : poses_) pose = first_from_start * pose;
    poses_.front() = Rigid3::Identity();
    return poses_;
  }

 private:
  // Camera k alone, to the points that are known.
  bool Place(size_t k) {
    const Rigid3 filter_motion =
        problem_.cameras[k + 1].world_from_camera.Inverse() * problem_.cameras[k].world_from_camera;
    const std::vector<DepthPoint> points = PointsSeenBy(k);
    std::vector<PointSight> sights;
    size_t next = 0;
    for (size_t i : observations_of_[k]) {
      const BundleObservation& observation = problem_.observations[i];
      if (!points_[observation.point]) continue;
      sights.push_back({&points[next++], observation.pixel, observation.sigma_px});
    }
    auto pose = Resect(resection_, *problem_.cameras[k].model, sights, poses_[k + 1]);
    if (!pose) {
      pose = Resect(resection_, *problem_.cameras[k].model, sights, poses_[k + 1] * filter_motion);
    }
    if (!pose && k + kTrustedCameras >= poses_.size()) pose = poses_[k + 1] * filter_motion;
    if (pose) poses_[k] = *pose;
    return pose.has_value();
  }

  // The known points among the observations of camera k, in their order.
  std::vector<DepthPoint> PointsSeenBy(size_t k) const {
    const Eigen::Vector3d anchor = poses_[k + 1].translation;
    std::vector<DepthPoint> points;
    for (size_t i : observations_of_[k]) {
      const std::optional<Eigen::Vector3d>& point = points_[problem_.observations[i].point];
      if (!point) continue;
      points.push_back({PointReference::At(anchor, *point), 1 / (*point - anchor).norm(), 0});
    }
    return points;
  }

  // The filter's own points stay; the others are placed anew with every camera that joins.
  void TriangulateSeenBy(size_t k) {
    for (size_t i : observations_of_[k]) {
      const int point = problem_.observations[i].point;
      if (from_filter_[point]) continue;
      std::vector<TrackSight> sights;
      for (size_t j = first_observation_of_[point];
           j < problem_.observations.size() && problem_.observations[j].point == point; ++j) {
        const BundleObservation& observation = problem_.observations[j];
        if (observation.camera < static_cast<int>(k)) continue;
        sights.push_back({{poses_[observation.camera], problem_.cameras[observation.camera].model},
                          observation.pixel,
                          observation.sigma_px});
      }
      if (sights.size() < 2) continue;
      const auto placed = TriangulateTrack(triangulation_, sights, std::nullopt, scene_depth_);
      if (placed) points_[point] = placed->point_in_world;
    }
  }

  const BundleProblem& problem_;
  const std::vector<std::optional<Eigen::Vector3d>>& from_filter_;
  std::vector<std::optional<Eigen::Vector3d>> points_;
  const TriangulationOptions& triangulation_;
  ResectionOptions resection_;
  const double scene_depth_;
  std::vector<Rigid3> poses_;
  std::vector<std::vector<size_t>> observations_of_;  // by camera
  std::vector<size_t> first_observation_of_;          // by point
};

}  // namespace

std::optional<std::vector<Rigid3>> StartBackward(
    const BundleProblem& problem, const std::vector<std::optional<Eigen::Vector3d>>& known,
    const BundleOptions& bundle, const TriangulationOptions& triangulation, double scene_depth) {
  return BackwardStart(problem, known, bundle, triangulation, scene_depth).Run();
}

}  // namespace portolan
