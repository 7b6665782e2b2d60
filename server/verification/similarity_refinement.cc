#include "server/verification/similarity_refinement.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>

namespace portolan {
namespace {

using Matrix27d = Eigen::Matrix<double, 2, 7>;

// d (S * Exp(d)) p / d d at d = 0, in S's target frame, is scale * R * [I, -[p]x, p].
Eigen::Matrix<double, 3, 7> PerturbationOf(const Eigen::Vector3d& point) {
  Eigen::Matrix<double, 3, 7> d_point;
  d_point << Eigen::Matrix3d::Identity(), -Skew(point), point;
  return d_point;
}

// One landmark in one keyframe of the other submap.
struct Sight {
  size_t match = 0;
  bool from_a = true;  // a's landmark in b's keyframe, else the other way
  const RefinedLandmark* landmark = nullptr;
  const Rigid3* camera_from_submap = nullptr;
  const CameraModel* camera = nullptr;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double variance_px2 = 1;
  double weight = 1;  // share of its match
  // Inverse covariance of the error, fixed between linearisations of the covariance.
  Eigen::Matrix2d information = Eigen::Matrix2d::Zero();
};

std::optional<LandmarkProjection> Project(const Sight& sight, const Similarity3& a_from_b) {
  const Eigen::Vector3d& point = sight.landmark->point_in_submap;
  return sight.from_a ? ProjectFromA(a_from_b, point, *sight.camera_from_submap, *sight.camera)
                      : ProjectFromB(a_from_b, point, *sight.camera_from_submap, *sight.camera);
}

class Problem {
 public:
  Problem(const SubmapPoints& a, const SubmapPoints& b, const std::vector<PointMatch>& matches,
          const SimilarityRefinementOptions& options)
      : options_(options), match_count_(matches.size()) {
    for (size_t m = 0; m < matches.size(); ++m) {
      const size_t first = sights_.size();
      AddSights(m, true, a.points[matches[m].a], b, b.points[matches[m].b]);
      AddSights(m, false, b.points[matches[m].b], a, a.points[matches[m].a]);
      const double count = static_cast<double>(sights_.size() - first);
      for (size_t i = first; i < sights_.size(); ++i) sights_[i].weight = 1.0 / count;
    }
  }

  // Evaluates the covariances of the errors at a_from_b. Sights that do not project count as far
  // outliers from now on.
  void SetInformation(const Similarity3& a_from_b) {
    for (Sight& sight : sights_) {
      sight.information.setZero();
      const auto projection = Project(sight, a_from_b);
      if (!projection) continue;
      const Matrix23d& jacobian = projection->d_pixel_d_landmark;
      Eigen::Matrix2d covariance = jacobian * sight.landmark->covariance * jacobian.transpose();
      covariance.diagonal().array() += sight.variance_px2;
      const Eigen::Matrix2d information = covariance.inverse();
      if (information.allFinite()) sight.information = information;
    }
  }

  struct Normal {
    double cost = 0;
    Matrix7d hessian = Matrix7d::Zero();
    Vector7d gradient = Vector7d::Zero();
  };

  // Cauchy cost w^2 / 2 log(1 + chi^2 / w^2), iteratively reweighted.
  Normal Linearise(const Similarity3& a_from_b) const {
    Normal normal;
    const double width_squared = options_.robust_width * options_.robust_width;
    for (const Sight& sight : sights_) {
      const auto projection = Project(sight, a_from_b);
      const double far = 1e6;
      const Eigen::Vector2d error =
          projection ? Eigen::Vector2d(projection->pixel - sight.pixel) : Eigen::Vector2d(0, 0);
      const double chi_squared = projection ? error.dot(sight.information * error) : far;
      normal.cost += sight.weight * 0.5 * width_squared * std::log1p(chi_squared / width_squared);
      if (!projection) continue;
      const double weight = sight.weight / (1 + chi_squared / width_squared);
      const Matrix27d& jacobian = projection->d_pixel_d_a_from_b;
      const Matrix27d weighted = weight * sight.information * jacobian;
      normal.hessian += jacobian.transpose() * weighted;
      normal.gradient += weighted.transpose() * error;
    }
    if (options_.fixed_scale) {
      normal.hessian.row(6).setZero();
      normal.hessian.col(6).setZero();
      normal.hessian(6, 6) = 1.0;
      normal.gradient[6] = 0;
    }
    return normal;
  }

  void FillErrors(RefinedSimilarity* refined) const {
    refined->chi_squared.assign(match_count_, 0.0);
    refined->error_px.assign(match_count_, 0.0);
    std::vector<int> counts(match_count_, 0);
    for (const Sight& sight : sights_) {
      const auto projection = Project(sight, refined->a_from_b);
      const double infinite = std::numeric_limits<double>::infinity();
      const Eigen::Vector2d error =
          projection ? Eigen::Vector2d(projection->pixel - sight.pixel) : Eigen::Vector2d(0, 0);
      refined->chi_squared[sight.match] +=
          projection ? sight.weight * error.dot(sight.information * error) : infinite;
      refined->error_px[sight.match] += projection ? sight.weight * error.squaredNorm() : infinite;
      ++counts[sight.match];
    }
    for (size_t m = 0; m < match_count_; ++m) {
      if (counts[m] == 0) refined->chi_squared[m] = std::numeric_limits<double>::infinity();
      refined->error_px[m] = std::sqrt(refined->error_px[m]);
    }
  }

 private:
  void AddSights(size_t match, bool from_a, const SubmapPoint& own, const SubmapPoints& other,
                 const SubmapPoint& seen) {
    if (own.landmark == nullptr || seen.views.empty()) return;
    const size_t size = seen.views.size();
    const size_t count = std::min<size_t>(size, options_.max_views);
    for (size_t i = 0; i < count; ++i) {
      // First and last keyframe and some between.
      const size_t v = count == 1 ? size / 2 : i * (size - 1) / (count - 1);
      const PointView& view = seen.views[v];
      Sight sight;
      sight.match = match;
      sight.from_a = from_a;
      sight.landmark = own.landmark;
      sight.camera_from_submap = &other.camera_from_submap[view.keyframe];
      sight.camera = other.submap->camera.get();
      sight.pixel = view.pixel;
      sight.variance_px2 = std::pow(options_.sigma_px * view.sigma_px, 2);
      sights_.push_back(sight);
    }
  }

  const SimilarityRefinementOptions& options_;
  size_t match_count_;
  std::vector<Sight> sights_;
};

// Descends from `a_from_b` with the covariances fixed; returns the normal equations at the end.
Problem::Normal Descend(const Problem& problem, int max_iterations, Similarity3* a_from_b) {
  double damping = 1e-4;
  Problem::Normal normal = problem.Linearise(*a_from_b);
  for (int iteration = 0; iteration < max_iterations; ++iteration) {
    Matrix7d damped = normal.hessian;
    damped.diagonal() += damping * normal.hessian.diagonal() + Vector7d::Constant(1e-12);
    const Vector7d step = -damped.ldlt().solve(normal.gradient);
    if (!step.allFinite()) break;
    const Similarity3 candidate = *a_from_b * Similarity3::Exp(step);
    const Problem::Normal next = problem.Linearise(candidate);
    if (next.cost < normal.cost) {
      const bool converged = normal.cost - next.cost < 1e-6 * normal.cost;
      *a_from_b = candidate;
      normal = next;
      damping = std::max(damping * 0.1, 1e-9);
      if (converged) break;
    } else {
      damping *= 10;
      if (damping > 1e6) break;
    }
  }
  return normal;
}

}  // namespace

std::optional<LandmarkProjection> ProjectFromA(const Similarity3& a_from_b,
                                               const Eigen::Vector3d& landmark_in_a,
                                               const Rigid3& camera_from_b,
                                               const CameraModel& camera_b) {
  const Similarity3 b_from_a = a_from_b.Inverse();
  const Eigen::Vector3d point_in_b = b_from_a * landmark_in_a;
  Matrix23d d_pixel_d_point;
  const auto pixel = camera_b.Project(camera_from_b * point_in_b, &d_pixel_d_point);
  if (!pixel) return std::nullopt;
  const Matrix23d d_pixel_d_point_in_b =
      d_pixel_d_point * camera_from_b.rotation.toRotationMatrix();
  // (S Exp(d))^-1 p_a = Exp(-d) S^-1 p_a.
  return LandmarkProjection{
      *pixel, -d_pixel_d_point_in_b * PerturbationOf(point_in_b),
      b_from_a.scale * d_pixel_d_point_in_b * b_from_a.rotation.toRotationMatrix()};
}

std::optional<LandmarkProjection> ProjectFromB(const Similarity3& a_from_b,
                                               const Eigen::Vector3d& landmark_in_b,
                                               const Rigid3& camera_from_a,
                                               const CameraModel& camera_a) {
  Matrix23d d_pixel_d_point;
  const auto pixel = camera_a.Project(camera_from_a * (a_from_b * landmark_in_b), &d_pixel_d_point);
  if (!pixel) return std::nullopt;
  const Matrix23d d_pixel_d_landmark =
      a_from_b.scale * d_pixel_d_point *
      (camera_from_a.rotation * a_from_b.rotation).toRotationMatrix();
  return LandmarkProjection{*pixel, d_pixel_d_landmark * PerturbationOf(landmark_in_b),
                            d_pixel_d_landmark};
}

std::optional<RefinedSimilarity> RefineSimilarity(const SubmapPoints& a, const SubmapPoints& b,
                                                  const std::vector<PointMatch>& matches,
                                                  const Similarity3& initial_a_from_b,
                                                  const SimilarityRefinementOptions& options) {
  if (matches.size() < 3) return std::nullopt;
  Problem problem(a, b, matches, options);
  RefinedSimilarity refined;
  refined.a_from_b = initial_a_from_b;
  // The second round has the covariances of the errors at the first one's result.
  for (int round = 0; round < 2; ++round) {
    problem.SetInformation(refined.a_from_b);
    refined.information = Descend(problem, options.max_iterations, &refined.a_from_b).hessian;
  }
  const bool finite = refined.a_from_b.translation.allFinite() &&
                      refined.a_from_b.rotation.coeffs().allFinite() &&
                      std::isfinite(refined.a_from_b.scale) && refined.a_from_b.scale > 0;
  if (!finite || !refined.information.allFinite()) return std::nullopt;
  problem.FillErrors(&refined);
  return refined;
}

}  // namespace portolan
