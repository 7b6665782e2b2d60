#include "agent/local_adjustment/known_fit.h"

#include <array>
#include <cmath>
#include <map>

#include "common/bundle/bundle_terms.h"
#include "common/linear_algebra/dense.h"

namespace portolan {
namespace {

using Matrix27d = Eigen::Matrix<double, 2, 7>;

// The loss is so much wider in the first step: the start may be off by more than matches err.
constexpr double kFirstLossFactor = 3;

constexpr int kUnknowns = 7;

// x -> pivot + t + s R (x - pivot).
struct Move {
  Eigen::Vector3d pivot;
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  double log_scale = 0;

  Eigen::Vector3d operator()(const Eigen::Vector3d& point) const {
    return pivot + translation + std::exp(log_scale) * (rotation * (point - pivot));
  }
  // [translation; rotation in the window's axes; log scale]
  void Add(const Vector7d& step) {
    translation += step.head<3>();
    rotation = (RotationExp(step.segment<3>(3)) * rotation).normalized();
    log_scale += step[6];
  }
  Vector7d Tangent() const {
    Vector7d tangent;
    tangent << translation, RotationLog(rotation), log_scale;
    return tangent;
  }
};

// The sight's error in sigmas and, unless null, its derivative by the move.
void Evaluate(const CameraModel& camera, const KnownView& view, const Move& move,
              Eigen::Vector2d* residual, Matrix27d* jacobian) {
  const Rigid3& before = view.window_from_camera;
  const CameraReference reference{{move.rotation * before.rotation, move(before.translation)},
                                  &camera};
  const Rigid3& pose = reference.world_from_camera;
  const PointReference point = PointReference::At(pose.translation, view.sight->point_in_world);
  const std::array<double, 3> parameters = {
      0, 0, 1 / (view.sight->point_in_world - pose.translation).norm()};
  Eigen::Matrix<double, 2, 6, Eigen::RowMajor> d_camera;
  ReprojectionError(&point, view.sight->pixel, view.sight->sigma_px)
      .Evaluate(CameraState(reference), parameters.data(), residual->data(),
                jacobian == nullptr ? nullptr : d_camera.data(), nullptr);
  if (jacobian == nullptr) return;
  // The camera's own perturbations are on the right, in its axes.
  const Eigen::Matrix3d camera_from_window = pose.rotation.conjugate().toRotationMatrix();
  const Eigen::Vector3d arm = pose.translation - move.pivot - move.translation;
  const Eigen::Matrix<double, 2, 3> d_position = d_camera.leftCols<3>() * camera_from_window;
  jacobian->leftCols<3>() = d_position;
  jacobian->middleCols<3>(3) =
      d_camera.rightCols<3>() * camera_from_window - d_position * Skew(arm);
  jacobian->col(6) = d_position * arm;
}

// Gauss-Newton with a Gaussian prior of the drift.
class Fit {
 public:
  struct Result {
    Move move;
    double cost = 0;  // -2 log of the density, but for a constant
  };

  Fit(const KnownFitOptions& options, const CameraModel& camera,
      const std::vector<KnownView>& views, double scene_depth, const Similarity3& moved_before)
      : options_(options),
        camera_(camera),
        views_(views),
        start_{views.back().window_from_camera.translation} {
    prior_ << Eigen::Vector3d::Constant(1 / (options.translation_of_depth * scene_depth)),
        Eigen::Vector3d::Constant(1 / options.rotation_rad), 1 / options.log_scale;
    prior_ = prior_.cwiseAbs2();
    before_ << start_.pivot - moved_before.Inverse() * start_.pivot,
        RotationLog(moved_before.rotation), std::log(moved_before.scale);
    std::map<KnownLandmarkId, int> sights_of;
    for (const KnownView& view : views) ++sights_of[view.sight->landmark];
    for (const KnownView& view : views) shares_.push_back(1.0 / sights_of[view.sight->landmark]);
  }

  // With a drift that is so many times larger.
  std::optional<Result> Run(double factor) const {
    const Vector7d prior = prior_ / (factor * factor);
    Result result{start_, 0};
    for (int i = 0; i < options_.max_iterations; ++i) {
      const double loss = options_.loss_scale_sigmas * (i == 0 ? kFirstLossFactor : 1);
      Matrix7d information = prior.asDiagonal();
      Vector7d step = -prior.cwiseProduct(before_ + result.move.Tangent());
      for (size_t k = 0; k < views_.size(); ++k) {
        Eigen::Vector2d residual;
        Matrix27d jacobian;
        Evaluate(camera_, views_[k], result.move, &residual, &jacobian);
        const double weight = shares_[k] / (1 + residual.squaredNorm() / (loss * loss));
        information.noalias() += weight * jacobian.transpose() * jacobian;
        step.noalias() -= weight * jacobian.transpose() * residual;
      }
      if (!SolvePositiveDefinite(information, step) || !step.allFinite()) return std::nullopt;
      result.move.Add(step);
    }
    const Vector7d drift = before_ + result.move.Tangent();
    result.cost = drift.dot(prior.cwiseProduct(drift)) + kUnknowns * 2 * std::log(factor);
    const double loss2 = options_.loss_scale_sigmas * options_.loss_scale_sigmas;
    for (size_t k = 0; k < views_.size(); ++k) {
      Eigen::Vector2d residual;
      Evaluate(camera_, views_[k], result.move, &residual, nullptr);
      result.cost += shares_[k] * loss2 * std::log1p(residual.squaredNorm() / loss2);
    }
    return result;
  }

 private:
  const KnownFitOptions& options_;
  const CameraModel& camera_;
  const std::vector<KnownView>& views_;
  const Move start_;
  Vector7d prior_;   // information
  Vector7d before_;  // tangent
  // By view: one over the views of its landmark.
  std::vector<double> shares_;
};

}  // namespace

Status KnownFitOptions::Validate() const {
  if (!(translation_of_depth > 0) || !(rotation_rad > 0) || !(log_scale > 0) ||
      !(map_drift_factor >= 1) || !(loss_scale_sigmas > 0) || max_iterations < 1 ||
      min_sights < 4) {
    return absl::InvalidArgumentError("local_adjustment.known_fit: a limit is out of range");
  }
  return absl::OkStatus();
}

std::optional<Similarity3> FitToKnown(const KnownFitOptions& options, const CameraModel& camera,
                                      const std::vector<KnownView>& views, double scene_depth,
                                      const Similarity3& moved_before) {
  if (static_cast<int>(views.size()) < options.min_sights) return std::nullopt;
  const Fit fit(options, camera, views, scene_depth, moved_before);
  const auto small = fit.Run(1), large = fit.Run(options.map_drift_factor);
  const auto& best = !large || (small && small->cost < large->cost) ? small : large;
  if (!best) return std::nullopt;
  const Move& move = best->move;
  Similarity3 moved;
  moved.scale = std::exp(move.log_scale);
  moved.rotation = move.rotation;
  moved.translation = move(Eigen::Vector3d::Zero());
  return moved;
}

}  // namespace portolan
