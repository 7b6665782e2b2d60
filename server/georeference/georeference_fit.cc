#include "server/georeference/georeference_fit.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>

#include "absl/strings/str_cat.h"

namespace portolan {
namespace {

constexpr int kSamples = 200;
constexpr int kMaxSteps = 30;
constexpr double kMinStep = 1e-9;

double MedianOf(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

Eigen::Matrix3d InformationIn(const SitePoint& point, const Similarity3& site_from_world) {
  const Eigen::Matrix3d turn = site_from_world.scale * site_from_world.rotation.toRotationMatrix();
  const Eigen::Matrix3d covariance =
      point.site_covariance + turn * point.world_covariance * turn.transpose();
  return covariance.llt().solve(Eigen::Matrix3d::Identity());
}

// Least squares over the perturbation q + t + w x (q - c) + s (q - c) of the points in the site.
class SiteSolver {
 public:
  SiteSolver(const GeoreferenceFitOptions& options, std::span<const SitePoint> points,
             AlignmentMode mode)
      : options_(options), points_(points), mode_(mode) {}

  bool Solve(Similarity3* fit) {
    if (!Sample(fit)) return false;
    for (int i = 0; i < kMaxSteps; ++i) {
      Linearize(*fit);
      const Eigen::LDLT<Eigen::MatrixXd> factor(information_);
      if (factor.info() != Eigen::Success || !factor.isPositive()) return false;
      const Eigen::VectorXd step = -factor.solve(gradient_);
      if (!step.allFinite()) return false;
      Apply(step, fit);
      if (step.head<3>().norm() < kMinStep * (1 + extent_) &&
          step.tail(step.size() - 3).norm() < kMinStep)
        break;
    }
    Linearize(*fit);
    return true;
  }

  // Why the points do not determine the fit; empty if they do.
  std::string Weakness() const {
    if (mode_ != AlignmentMode::kYaw) {
      const double ratio = ExtentRatio();
      if (ratio < options_.min_extent_ratio) {
        return absl::StrCat("the points lie on a line (their extent across it is ",
                            std::round(1000 * ratio) / 10,
                            " % of that along it): the turn about it is unknown");
      }
    }
    const Eigen::LDLT<Eigen::MatrixXd> factor(information_);
    const Eigen::MatrixXd covariance =
        factor.solve(Eigen::MatrixXd::Identity(information_.rows(), information_.cols()));
    const int turns = mode_ == AlignmentMode::kYaw ? 1 : 3;
    double worst = 0;
    for (int i = 3; i < 3 + turns; ++i) worst = std::max(worst, covariance(i, i));
    const double sigma = std::sqrt(worst);
    if (!(sigma <= options_.max_rotation_sigma_rad)) {
      return absl::StrCat(
          "the points lie too close together for their accuracy: the turn is "
          "uncertain by ",
          std::round(10 * sigma * 180 / std::numbers::pi) / 10, " degrees");
    }
    if (mode_ == AlignmentMode::kSim3 &&
        !(std::sqrt(covariance(6, 6)) <= options_.max_log_scale_sigma)) {
      return absl::StrCat(
          "the points lie too close together for their accuracy: the scale is "
          "uncertain by ",
          std::round(1000 * std::sqrt(covariance(6, 6))) / 10, " %");
    }
    return "";
  }

 private:
  int Parameters() const {
    return mode_ == AlignmentMode::kSim3 ? 7 : mode_ == AlignmentMode::kSe3 ? 6 : 4;
  }

  // The best of random triples by the median of the squared errors: half of the points may be
  // wrong.
  bool Sample(Similarity3* best) const {
    std::vector<Eigen::Vector3d> world, site;
    for (const SitePoint& point : points_) {
      world.push_back(point.in_world);
      site.push_back(point.in_site);
    }
    double lowest = std::numeric_limits<double>::infinity();
    const auto consider = [&](const std::optional<Similarity3>& fit) {
      if (!fit || !(fit->scale > 0) || !std::isfinite(fit->scale)) return;
      const double median = MedianOf(SiteChi2(points_, *fit));
      if (!(median < lowest)) return;
      lowest = median;
      *best = *fit;
    };
    consider(AlignPoints(world, site, mode_));
    std::mt19937 random(1);
    std::uniform_int_distribution<size_t> pick(0, points_.size() - 1);
    for (int i = 0; i < kSamples; ++i) {
      std::vector<Eigen::Vector3d> from, to;
      for (int k = 0; k < 3; ++k) {
        const size_t at = pick(random);
        from.push_back(world[at]);
        to.push_back(site[at]);
      }
      consider(AlignPoints(from, to, mode_));
    }
    return std::isfinite(lowest);
  }

  void Linearize(const Similarity3& fit) {
    const std::vector<double> weights = SiteWeights(options_, SiteChi2(points_, fit));
    center_.setZero();
    double sum = 0;
    for (size_t i = 0; i < points_.size(); ++i) {
      center_ += weights[i] * points_[i].in_site;
      sum += weights[i];
    }
    center_ /= sum;
    spread_.setZero();
    information_.setZero(Parameters(), Parameters());
    gradient_.setZero(Parameters());
    for (size_t i = 0; i < points_.size(); ++i) {
      const Eigen::Vector3d in_site = fit * points_[i].in_world;
      const Eigen::Vector3d arm = in_site - center_;
      const Eigen::Vector3d place = points_[i].in_site - center_;
      spread_ += weights[i] / sum * place * place.transpose();
      Eigen::MatrixXd jacobian(3, Parameters());
      jacobian.leftCols<3>().setIdentity();
      if (mode_ == AlignmentMode::kYaw) {
        jacobian.col(3) = Eigen::Vector3d::UnitZ().cross(arm);
      } else {
        jacobian.middleCols<3>(3) = -Skew(arm);
      }
      if (mode_ == AlignmentMode::kSim3) jacobian.col(6) = arm;
      const Eigen::Matrix3d weighted =
          weights[i] * points_[i].share * InformationIn(points_[i], fit);
      information_ += jacobian.transpose() * weighted * jacobian;
      gradient_ += jacobian.transpose() * weighted * (in_site - points_[i].in_site);
    }
    extent_ = std::sqrt(spread_.trace());
  }

  void Apply(const Eigen::VectorXd& step, Similarity3* fit) const {
    Similarity3 change;
    if (mode_ == AlignmentMode::kYaw) {
      change.rotation = Eigen::AngleAxisd(step[3], Eigen::Vector3d::UnitZ());
    } else if (const double angle = step.segment<3>(3).norm(); angle > 0) {
      change.rotation = Eigen::AngleAxisd(angle, step.segment<3>(3) / angle);
    }
    if (mode_ == AlignmentMode::kSim3) change.scale = std::exp(step[6]);
    change.translation = center_ + step.head<3>() - change.scale * (change.rotation * center_);
    *fit = change * *fit;
    fit->rotation.normalize();
  }

  // Of the second to the first principal extent.
  double ExtentRatio() const {
    const Eigen::Vector3d values =
        Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(spread_).eigenvalues();
    return values[2] > 0 ? std::sqrt(std::max(values[1], 0.0) / values[2]) : 0;
  }

  const GeoreferenceFitOptions& options_;
  const std::span<const SitePoint> points_;
  const AlignmentMode mode_;
  Eigen::Vector3d center_ = Eigen::Vector3d::Zero();
  Eigen::Matrix3d spread_ = Eigen::Matrix3d::Zero();
  double extent_ = 0;
  Eigen::MatrixXd information_;
  Eigen::VectorXd gradient_;
};

}  // namespace

Status GeoreferenceFitOptions::Validate() const {
  if (!(outlier_sigmas > 0) || !(max_rotation_sigma_rad > 0) || !(max_log_scale_sigma > 0) ||
      !(min_extent_ratio >= 0)) {
    return absl::InvalidArgumentError("georeference: limits out of range");
  }
  return absl::OkStatus();
}

std::vector<double> SiteChi2(std::span<const SitePoint> points,
                             const Similarity3& site_from_world) {
  std::vector<double> chi2;
  for (const SitePoint& point : points) {
    const Eigen::Vector3d error = site_from_world * point.in_world - point.in_site;
    chi2.push_back(error.dot(InformationIn(point, site_from_world) * error));
  }
  return chi2;
}

double SiteLossSquare(const GeoreferenceFitOptions& options, const std::vector<double>& chi2) {
  const double least = options.outlier_sigmas * options.outlier_sigmas;
  return chi2.empty() ? least : std::max(least, 9 * MedianOf(chi2));
}

std::vector<double> SiteWeights(const GeoreferenceFitOptions& options,
                                const std::vector<double>& chi2) {
  const double limit = SiteLossSquare(options, chi2);
  std::vector<double> weights;
  for (const double one : chi2) weights.push_back(1 / (1 + one / limit));
  return weights;
}

GeoreferenceFit FitGeoreference(const GeoreferenceFitOptions& options,
                                std::span<const SitePoint> points, bool is_metric,
                                bool is_vertical) {
  GeoreferenceFit result;
  if (points.size() < 3) {
    result.problem = absl::StrCat("at least 3 positions are needed, there are ", points.size());
    return result;
  }
  std::vector<AlignmentMode> modes = {AlignmentMode::kSim3};
  if (is_metric) modes.push_back(AlignmentMode::kSe3);
  if (is_metric && is_vertical) modes.push_back(AlignmentMode::kYaw);
  for (const AlignmentMode mode : modes) {
    SiteSolver solver(options, points, mode);
    Similarity3 fit;
    result.problem = "the points have no extent";
    if (!solver.Solve(&fit)) continue;
    result.problem = solver.Weakness();
    if (!result.problem.empty()) continue;
    result.site_from_world = fit;
    result.mode = mode;
    return result;
  }
  return result;
}

}  // namespace portolan
