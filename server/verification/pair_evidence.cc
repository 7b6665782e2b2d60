#include "server/verification/pair_evidence.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

namespace portolan {
namespace {

// Solid angle of the image, from its area at the mean focal length.
double ImageArea(const CameraModel& camera) {
  return camera.width_px() * camera.height_px() / (camera.mean_focal_px() * camera.mean_focal_px());
}

Matrix23d PlaneAcross(const Eigen::Vector3d& bearing) {
  Matrix23d across;
  across.row(0) = bearing.unitOrthogonal().transpose();
  across.row(1) = bearing.cross(across.row(0).transpose()).transpose();
  return across;
}

// `own`'s landmark, seen by `other` in one of its keyframes.
std::optional<RaySight> MakeSight(const SubmapPoint& own, const SubmapPoints& other,
                                  const SubmapPoint& other_point, int other_keyframe,
                                  double sigma_px) {
  if (own.landmark == nullptr) return std::nullopt;
  const PointView* view = ViewIn(other_point, other_keyframe);
  if (view == nullptr || !view->bearing) return std::nullopt;
  RaySight sight;
  sight.landmark_in_own = own.landmark->point_in_submap;
  sight.covariance = own.landmark->covariance.Matrix();
  sight.camera_from_other = &other.camera_from_submap[other_keyframe];
  sight.camera_rotation_other = sight.camera_from_other->rotation.toRotationMatrix();
  sight.bearing = *view->bearing;
  sight.across = PlaneAcross(sight.bearing);
  const double sigma_rad = sigma_px * view->sigma_px / other.submap->camera->mean_focal_px();
  sight.variance_rad2 = sigma_rad * sigma_rad;
  return sight;
}

}  // namespace

PairEvidence::Placement::Placement(const Similarity3& similarity)
    : scaled_rotation(similarity.scale * similarity.rotation.toRotationMatrix()),
      translation(similarity.translation),
      scale(similarity.scale) {}

PairEvidence::PairEvidence(const SubmapPoints& a, const SubmapPoints& b,
                           std::vector<PointMatch> matches, const PairEvidenceOptions& options)
    : options_(options), point_count_a_(a.points.size()), point_count_b_(b.points.size()) {
  double least_variance = 1.0;
  for (const PointMatch& match : matches) {
    const SubmapPoint& point_a = a.points[match.a];
    const SubmapPoint& point_b = b.points[match.b];
    MatchSights sights;
    sights.of_a = MakeSight(point_a, b, point_b, match.keyframe_b, options.sigma_px);
    sights.of_b = MakeSight(point_b, a, point_a, match.keyframe_a, options.sigma_px);
    if (!sights.of_a && !sights.of_b) continue;
    for (const auto& sight : {sights.of_a, sights.of_b}) {
      if (sight) least_variance = std::min(least_variance, sight->variance_rad2);
    }
    sights_.push_back(sights);
    matches_.push_back(match);
  }
  const double area = std::min(ImageArea(*a.submap->camera), ImageArea(*b.submap->camera));
  log_chance_density_ = -std::log(area);
  most_evidence_ =
      std::max(0.0, -std::log(2 * std::numbers::pi * least_variance) - log_chance_density_);
}

double PairEvidence::EvidenceOf(const RaySight& sight, const Placement& other_from_own) const {
  const Eigen::Vector3d in_other =
      other_from_own.scaled_rotation * sight.landmark_in_own + other_from_own.translation;
  const Eigen::Vector3d point =
      sight.camera_rotation_other * in_other + sight.camera_from_other->translation;
  const double depth_squared = point.squaredNorm();
  const double along = point.dot(sight.bearing);
  if (!(along > 0) || !(along * along > 0.25 * depth_squared)) return 0;
  const double depth = std::sqrt(depth_squared);
  const Eigen::Vector2d error = sight.across * point / depth;
  // Most hypotheses fail here, without the covariance: its trace bounds its eigenvalues.
  const double relative_scale = other_from_own.scale / depth;
  const double most_variance =
      sight.variance_rad2 + relative_scale * relative_scale * sight.covariance.trace();
  if (!(error.squaredNorm() < options_.max_chi_squared * most_variance)) return 0;
  const Matrix23d spread =
      (sight.across * sight.camera_rotation_other) * other_from_own.scaled_rotation / depth;
  Eigen::Matrix2d covariance = spread * sight.covariance * spread.transpose();
  covariance.diagonal().array() += sight.variance_rad2;
  const double determinant = covariance.determinant();
  const double chi_squared =
      (error.x() * error.x() * covariance(1, 1) - 2 * error.x() * error.y() * covariance(0, 1) +
       error.y() * error.y() * covariance(0, 0)) /
      determinant;
  if (!(chi_squared < options_.max_chi_squared)) return 0;
  const double log_density =
      -std::log(2 * std::numbers::pi * std::sqrt(determinant)) - 0.5 * chi_squared;
  return std::max(0.0, log_density - log_chance_density_);
}

double PairEvidence::EvidenceOf(const MatchSights& sights, const Placement& a_from_b,
                                const Placement& b_from_a) const {
  double evidence = most_evidence_;
  if (sights.of_a) evidence = std::min(evidence, EvidenceOf(*sights.of_a, b_from_a));
  if (sights.of_b && evidence > 0) {
    evidence = std::min(evidence, EvidenceOf(*sights.of_b, a_from_b));
  }
  return evidence;
}

std::vector<double> PairEvidence::EvidenceOfEach(const Similarity3& a_from_b) const {
  const Placement forward(a_from_b), backward(a_from_b.Inverse());
  std::vector<double> evidence;
  for (const MatchSights& sights : sights_) {
    evidence.push_back(EvidenceOf(sights, forward, backward));
  }
  return evidence;
}

double PairEvidence::TotalEvidence(const Similarity3& a_from_b, double at_least) const {
  const Placement forward(a_from_b), backward(a_from_b.Inverse());
  double total = 0;
  for (size_t i = 0; i < sights_.size(); ++i) {
    total += EvidenceOf(sights_[i], forward, backward);
    if (total + (sights_.size() - i - 1) * most_evidence_ < at_least) return 0;
  }
  return total;
}

double PairEvidence::TotalEvidenceOfPoints(const Similarity3& a_from_b) const {
  const std::vector<double> evidence = EvidenceOfEach(a_from_b);
  std::vector<double> best_of_a(point_count_a_, 0.0), best_of_b(point_count_b_, 0.0);
  for (size_t i = 0; i < matches_.size(); ++i) {
    double& of_a = best_of_a[matches_[i].a];
    double& of_b = best_of_b[matches_[i].b];
    of_a = std::max(of_a, evidence[i]);
    of_b = std::max(of_b, evidence[i]);
  }
  return std::min(std::accumulate(best_of_a.begin(), best_of_a.end(), 0.0),
                  std::accumulate(best_of_b.begin(), best_of_b.end(), 0.0));
}

}  // namespace portolan
