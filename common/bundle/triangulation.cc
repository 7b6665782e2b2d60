#include "common/bundle/triangulation.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "common/linear_algebra/dense.h"

namespace portolan {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
// A hypothesis that is tried later must be better by this much than a more believable earlier one.
constexpr double kMarginChi2 = 2.0;

double SightChi2(const TrackSight& sight, const Eigen::Vector3d& point_in_world) {
  const Rigid3& pose = sight.camera.world_from_camera;
  const std::optional<Eigen::Vector2d> pixel =
      sight.camera.model->Project(pose.rotation.conjugate() * (point_in_world - pose.translation));
  if (!pixel) return kInfinity;
  return (*pixel - sight.pixel).squaredNorm() / (sight.sigma_px * sight.sigma_px);
}

// Point nearest to both rays (origins o, unit directions d); none if it lies behind a camera or
// the rays are parallel.
std::optional<Eigen::Vector3d> Midpoint(const Eigen::Vector3d& o1, const Eigen::Vector3d& d1,
                                        const Eigen::Vector3d& o2, const Eigen::Vector3d& d2) {
  const Eigen::Vector3d baseline = o2 - o1;
  const double cosine = d1.dot(d2);
  const double determinant = 1.0 - cosine * cosine;
  if (determinant < 1e-10) return std::nullopt;
  const double s1 = (baseline.dot(d1) - cosine * baseline.dot(d2)) / determinant;
  const double s2 = (cosine * baseline.dot(d1) - baseline.dot(d2)) / determinant;
  if (s1 <= 0 || s2 <= 0) return std::nullopt;
  return 0.5 * (o1 + s1 * d1 + o2 + s2 * d2);
}

class Triangulator {
 public:
  Triangulator(const TriangulationOptions& options, const std::vector<TrackSight>& sights,
               double scene_depth)
      : options_(options), sights_(sights), scene_depth_(scene_depth) {}

  std::optional<TriangulatedPoint> Run(const std::optional<Eigen::Vector3d>& guess) {
    if (sights_.size() < 2) return std::nullopt;
    if (guess) Try(*guess, 0);
    TryDepths();
    TryPairs();
    if (best_count_ < 2) return std::nullopt;
    Refine();
    TriangulatedPoint result;
    result.point_in_world = best_;
    for (const TrackSight& sight : sights_) {
      result.inliers.push_back(SightChi2(sight, best_) < options_.inlier_chi2);
      result.inlier_count += result.inliers.back() ? 1 : 0;
    }
    if (result.inlier_count < 2) return std::nullopt;
    return result;
  }

 private:
  // Takes the point if it costs less than the best one by more than `margin`.
  void Try(const Eigen::Vector3d& point, double margin) {
    int count = 0;
    double cost = 0;
    for (const TrackSight& sight : sights_) {
      const double chi2 = SightChi2(sight, point);
      count += chi2 < options_.inlier_chi2 ? 1 : 0;
      cost += std::min(chi2, options_.inlier_chi2);
    }
    if (!(cost < best_cost_ - margin)) return;
    best_ = point;
    best_cost_ = cost;
    best_count_ = count;
  }

  // The first ray at the scene's depth and at its far end.
  void TryDepths() {
    const TrackSight& sight = sights_.front();
    const std::optional<Eigen::Vector3d> bearing = sight.camera.model->Unproject(sight.pixel);
    if (!bearing) return;
    const Rigid3& pose = sight.camera.world_from_camera;
    Try(pose * (scene_depth_ * *bearing), kMarginChi2);
    Try(pose * (options_.far_scene_depths * scene_depth_ * *bearing), kMarginChi2);
  }

  // Up to six pairs among four sights spread over the track.
  void TryPairs() {
    const size_t last = sights_.size() - 1;
    const std::array<size_t, 4> picks = {0, last / 3, 2 * last / 3, last};
    std::array<std::optional<Eigen::Vector3d>, 4> rays;
    for (size_t i = 0; i < picks.size(); ++i) {
      const TrackSight& sight = sights_[picks[i]];
      const std::optional<Eigen::Vector3d> bearing = sight.camera.model->Unproject(sight.pixel);
      if (bearing) rays[i] = sight.camera.world_from_camera.rotation * *bearing;
    }
    for (size_t i = 0; i < picks.size(); ++i) {
      for (size_t j = i + 1; j < picks.size(); ++j) {
        if (!rays[i] || !rays[j] || picks[i] == picks[j]) continue;
        const std::optional<Eigen::Vector3d> point =
            Midpoint(sights_[picks[i]].camera.world_from_camera.translation, *rays[i],
                     sights_[picks[j]].camera.world_from_camera.translation, *rays[j]);
        if (point) Try(*point, kMarginChi2);
      }
    }
  }

  // Gauss-Newton over (u, v, rho); rho moves by about the inverse of the scene's depth a step, so
  // that noise does not decide where the rays do not.
  void Refine() {
    const auto first = std::find_if(sights_.begin(), sights_.end(), [this](const TrackSight& s) {
      return SightChi2(s, best_) < options_.inlier_chi2;
    });
    const Eigen::Vector3d anchor = first->camera.world_from_camera.translation;
    for (const TrackSight& sight : sights_) states_.emplace_back(sight.camera);
    for (int i = 0; i < options_.max_iterations; ++i) {
      const PointReference reference = PointReference::At(anchor, best_);
      Eigen::Vector3d parameters(0, 0, 1.0 / (best_ - anchor).norm());
      Eigen::Matrix3d information = Eigen::Vector3d(0, 0, scene_depth_ * scene_depth_).asDiagonal();
      Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
      Accumulate(reference, parameters, &information, &gradient);
      Eigen::Vector3d step = -gradient;
      SolveSymmetric(information, step);
      if (!step.allFinite()) return;
      parameters += step;
      const double cost = best_cost_;
      Try(reference.Apply(parameters.data(), 1.0 / (options_.far_scene_depths * scene_depth_)), 0);
      if (!(best_cost_ < cost * (1 - 1e-6))) return;
    }
  }

  void Accumulate(const PointReference& reference, const Eigen::Vector3d& parameters,
                  Eigen::Matrix3d* information, Eigen::Vector3d* gradient) const {
    for (size_t i = 0; i < sights_.size(); ++i) {
      const TrackSight& sight = sights_[i];
      if (!(SightChi2(sight, best_) < options_.inlier_chi2)) continue;
      const ReprojectionError error(&reference, sight.pixel, sight.sigma_px);
      Eigen::Vector2d residual;
      Eigen::Matrix<double, 2, 3, Eigen::RowMajor> jacobian;
      error.Evaluate(states_[i], parameters.data(), residual.data(), nullptr, jacobian.data());
      *information += jacobian.transpose() * jacobian;
      *gradient += jacobian.transpose() * residual;
    }
  }

  const TriangulationOptions& options_;
  const std::vector<TrackSight>& sights_;
  double scene_depth_;
  std::vector<CameraState> states_;  // of the sights' cameras, for Refine
  Eigen::Vector3d best_ = Eigen::Vector3d::Zero();
  double best_cost_ = kInfinity;
  int best_count_ = 0;
};

}  // namespace

Status TriangulationOptions::Validate() const {
  if (!(inlier_chi2 > 0) || max_iterations < 1 || !(far_scene_depths > 1)) {
    return absl::InvalidArgumentError(
        "triangulation: inlier_chi2, max_iterations and far_scene_depths must be positive");
  }
  return absl::OkStatus();
}

std::optional<TriangulatedPoint> TriangulateTrack(const TriangulationOptions& options,
                                                  const std::vector<TrackSight>& sights,
                                                  const std::optional<Eigen::Vector3d>& guess,
                                                  double scene_depth) {
  return Triangulator(options, sights, scene_depth).Run(guess);
}

}  // namespace portolan
