#include "server/verification/similarity_refinement.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "common/linear_algebra/dense.h"

namespace portolan {
namespace {

using Matrix27d = Eigen::Matrix<double, 2, 7>;

// How the points of one submap come to a camera of the other: all that does not depend on the
// point.
struct Transfer {
  // Into the submap of the camera; as seen from a it is the inverse of what is sought.
  bool from_a = true;
  Eigen::Matrix3d moved_from_point;
  Eigen::Vector3d moved_origin;
  Eigen::Matrix3d camera_from_moved;  // rotation
  Eigen::Vector3d submap_origin_in_camera;
};

Transfer TransferOf(bool from_a, const Similarity3& a_from_b, const Rigid3& camera_from_submap) {
  const Similarity3 moved_from_point = from_a ? a_from_b.Inverse() : a_from_b;
  return {from_a, moved_from_point.scale * moved_from_point.rotation.toRotationMatrix(),
          moved_from_point.translation, camera_from_submap.rotation.toRotationMatrix(),
          camera_from_submap.translation};
}

// The derivative's row by a point's right perturbation [translation; rotation; log scale], given
// the row by the point: d (S * Exp(d)) p / d d at d = 0, in S's source frame, is [I, -[p]x, p].
Eigen::Matrix<double, 1, 7> PerturbationRow(const Eigen::Vector3d& d_point,
                                            const Eigen::Vector3d& point) {
  Eigen::Matrix<double, 1, 7> row;
  row << d_point.transpose(), point.cross(d_point).transpose(), point.dot(d_point);
  return row;
}

std::optional<LandmarkProjection> Project(const Transfer& transfer, const Eigen::Vector3d& point,
                                          const CameraModel& camera) {
  const Eigen::Vector3d moved = transfer.moved_from_point * point + transfer.moved_origin;
  Matrix23d d_pixel_d_camera;
  const auto pixel = camera.Project(
      transfer.camera_from_moved * moved + transfer.submap_origin_in_camera, &d_pixel_d_camera);
  if (!pixel) return std::nullopt;
  LandmarkProjection projection;
  projection.pixel = *pixel;
  const Matrix23d d_pixel_d_moved = d_pixel_d_camera * transfer.camera_from_moved;
  projection.d_pixel_d_landmark = d_pixel_d_moved * transfer.moved_from_point;
  for (int i = 0; i < 2; ++i) {
    // (S Exp(d))^-1 p_a = Exp(-d) S^-1 p_a.
    projection.d_pixel_d_a_from_b.row(i) =
        transfer.from_a ? PerturbationRow(-d_pixel_d_moved.row(i).transpose(), moved)
                        : PerturbationRow(projection.d_pixel_d_landmark.row(i).transpose(), point);
  }
  return projection;
}

// One landmark in one keyframe of the other submap.
struct Sight {
  size_t match = 0;
  const RefinedLandmark* landmark = nullptr;
  size_t view = 0;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double variance_px2 = 1;
  double weight = 1;  // share of its match
  // Inverse covariance of the error, fixed between linearisations of the covariance.
  Eigen::Matrix2d information = Eigen::Matrix2d::Zero();
};

// Landmarks of a (else of b) in one keyframe of the other submap.
struct View {
  bool from_a = true;
  const Rigid3* camera_from_submap = nullptr;
  const CameraModel* camera = nullptr;
};

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
    const std::vector<Transfer> transfers = TransfersAt(a_from_b);
    for (Sight& sight : sights_) {
      sight.information.setZero();
      const auto projection = ProjectSight(sight, transfers);
      if (!projection) continue;
      const Matrix23d& jacobian = projection->d_pixel_d_landmark;
      Eigen::Matrix2d covariance =
          jacobian * sight.landmark->covariance.Matrix() * jacobian.transpose();
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
    const std::vector<Transfer> transfers = TransfersAt(a_from_b);
    for (const Sight& sight : sights_) {
      const auto projection = ProjectSight(sight, transfers);
      const double far = 1e6;
      const Eigen::Vector2d error =
          projection ? Eigen::Vector2d(projection->pixel - sight.pixel) : Eigen::Vector2d(0, 0);
      const double chi_squared = projection ? error.dot(sight.information * error) : far;
      normal.cost += sight.weight * 0.5 * width_squared * std::log1p(chi_squared / width_squared);
      if (!projection) continue;
      const double weight = sight.weight / (1 + chi_squared / width_squared);
      const Matrix27d& jacobian = projection->d_pixel_d_a_from_b;
      const Matrix27d weighted = (weight * sight.information).lazyProduct(jacobian);
      normal.hessian.noalias() += jacobian.transpose().lazyProduct(weighted);
      normal.gradient.noalias() += weighted.transpose() * error;
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
    const std::vector<Transfer> transfers = TransfersAt(refined->a_from_b);
    for (const Sight& sight : sights_) {
      const auto projection = ProjectSight(sight, transfers);
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
      sight.landmark = own.landmark;
      sight.view = ViewOf(from_a, other, view.keyframe);
      sight.pixel = view.pixel;
      sight.variance_px2 = std::pow(options_.sigma_px * view.sigma_px, 2);
      sights_.push_back(sight);
    }
  }

  size_t ViewOf(bool from_a, const SubmapPoints& other, int keyframe) {
    const Rigid3* camera_from_submap = &other.camera_from_submap[keyframe];
    size_t view = 0;
    while (view < views_.size() && (views_[view].from_a != from_a ||
                                    views_[view].camera_from_submap != camera_from_submap)) {
      ++view;
    }
    if (view == views_.size()) {
      views_.push_back({from_a, camera_from_submap, other.submap->camera.get()});
    }
    return view;
  }

  std::vector<Transfer> TransfersAt(const Similarity3& a_from_b) const {
    std::vector<Transfer> transfers;
    for (const View& view : views_) {
      transfers.push_back(TransferOf(view.from_a, a_from_b, *view.camera_from_submap));
    }
    return transfers;
  }

  std::optional<LandmarkProjection> ProjectSight(const Sight& sight,
                                                 const std::vector<Transfer>& transfers) const {
    return Project(transfers[sight.view], sight.landmark->point_in_submap,
                   *views_[sight.view].camera);
  }

  const SimilarityRefinementOptions& options_;
  size_t match_count_;
  std::vector<View> views_;
  std::vector<Sight> sights_;
};

// Relative decrease of the cost under which a round has converged: the first only has to bring the
// covariances of the errors, the last the result, whose own error is thousands of times larger.
constexpr double kFirstTolerance = 1e-3;
constexpr double kLastTolerance = 1e-5;

// Descends from `a_from_b` with the covariances fixed; returns the normal equations at the end.
Problem::Normal Descend(const Problem& problem, int max_iterations, double tolerance,
                        Similarity3* a_from_b) {
  double damping = 1e-4;
  Problem::Normal normal = problem.Linearise(*a_from_b);
  for (int iteration = 0; iteration < max_iterations; ++iteration) {
    Matrix7d damped = normal.hessian;
    damped.diagonal() += damping * normal.hessian.diagonal() + Vector7d::Constant(1e-12);
    Vector7d step = -normal.gradient;
    SolveSymmetric(damped, step);
    if (!step.allFinite()) break;
    const Similarity3 candidate = *a_from_b * Similarity3::Exp(step);
    const Problem::Normal next = problem.Linearise(candidate);
    if (next.cost < normal.cost) {
      const bool converged = normal.cost - next.cost < tolerance * normal.cost;
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
  return Project(TransferOf(true, a_from_b, camera_from_b), landmark_in_a, camera_b);
}

std::optional<LandmarkProjection> ProjectFromB(const Similarity3& a_from_b,
                                               const Eigen::Vector3d& landmark_in_b,
                                               const Rigid3& camera_from_a,
                                               const CameraModel& camera_a) {
  return Project(TransferOf(false, a_from_b, camera_from_a), landmark_in_b, camera_a);
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
    const double tolerance = round == 0 ? kFirstTolerance : kLastTolerance;
    refined.information =
        Descend(problem, options.max_iterations, tolerance, &refined.a_from_b).hessian;
  }
  const bool finite = refined.a_from_b.translation.allFinite() &&
                      refined.a_from_b.rotation.coeffs().allFinite() &&
                      std::isfinite(refined.a_from_b.scale) && refined.a_from_b.scale > 0;
  if (!finite || !refined.information.allFinite()) return std::nullopt;
  problem.FillErrors(&refined);
  return refined;
}

}  // namespace portolan
