#include "server/refinement/bundle_covariance.h"

#include <algorithm>
#include <array>
#include <utility>

#include "common/linear_algebra/dense.h"
#include "server/refinement/bundle_costs.h"

namespace portolan {
namespace {

// Relative standard deviation of the scale that is "exact": far under any pixel's influence, yet
// the system stays well conditioned. It grows to this many squared ratios of depth to path where
// the camera hardly moved and the norm of its positions is nothing but noise: 0.04 % at a path of
// half the depth, 25 % at a fiftieth.
constexpr double kHeldScaleSigma = 1e-5;
constexpr double kHeldScaleSigmaOfDepth = 1e-4;
constexpr double kMinRhoOfMedian = 1e-4;

}  // namespace

class BundleCovarianceBuilder {
 public:
  explicit BundleCovarianceBuilder(const BundleProblem& problem) : problem_(problem) {}

  std::optional<BundleCovariance> Run() {
    NumberCameras();
    AddObservations();
    EliminatePoints();
    if (rows_ > 0) {
      AddDistances();
      HoldScale();
      result_.camera_covariance_ = Eigen::MatrixXd::Identity(rows_, rows_);
      if (!SolvePositiveDefinite(reduced_, result_.camera_covariance_)) return std::nullopt;
      if (!result_.camera_covariance_.allFinite()) return std::nullopt;
    }
    return std::move(result_);
  }

 private:
  struct PointSystem {
    int count = 0;
    PointReference reference;
    Eigen::Vector3d parameters = Eigen::Vector3d::Zero();
    Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
    std::vector<std::pair<int, Eigen::Matrix<double, 3, 6>>> couplings;  // H_pc of a camera row
  };

  void NumberCameras() {
    for (const BundleCamera& camera : problem_.cameras) {
      references_.push_back({camera.world_from_camera, camera.model});
      result_.camera_rows_.push_back(camera.fixed ? -1 : rows_);
      if (!camera.fixed) rows_ += 6;
    }
    reduced_ = Eigen::MatrixXd::Zero(rows_, rows_);
    result_.points_.resize(problem_.points.size());
    systems_.resize(problem_.points.size());
  }

  void AddObservations() {
    const double median_depth = MedianDepth(problem_);
    min_rho_ = kMinRhoOfMedian / median_depth;
    for (const BundleObservation& observation : problem_.observations) {
      if (observation.inlier) ++systems_[observation.point].count;
    }
    for (const BundleObservation& observation : problem_.observations) {
      PointSystem& system = systems_[observation.point];
      if (!observation.inlier || system.count < 2) continue;
      if (system.information.isZero()) Anchor(observation, median_depth, &system);
      AddObservation(observation, &system);
    }
  }

  void Anchor(const BundleObservation& observation, double median_depth, PointSystem* system) {
    const Eigen::Vector3d& anchor =
        problem_.cameras[observation.camera].world_from_camera.translation;
    const Eigen::Vector3d& point = problem_.points[observation.point].point_in_world;
    system->reference = PointReference::At(anchor, point);
    system->parameters[2] = 1.0 / std::max((point - anchor).norm(), 1e-9);
    const double sigma = std::max(system->parameters[2], 1.0 / median_depth);
    system->information(2, 2) = 1.0 / (sigma * sigma);
  }

  void AddObservation(const BundleObservation& observation, PointSystem* system) {
    const std::array<double, 6> zero{};
    const std::array<const double*, 2> blocks = {zero.data(), system->parameters.data()};
    const ReprojectionCost cost(&references_[observation.camera], &system->reference,
                                observation.pixel, observation.sigma_px);
    Eigen::Vector2d residual;
    Eigen::Matrix<double, 2, 6, Eigen::RowMajor> d_camera;
    Eigen::Matrix<double, 2, 3, Eigen::RowMajor> d_point;
    std::array<double*, 2> jacobians = {d_camera.data(), d_point.data()};
    cost.Evaluate(blocks.data(), residual.data(), jacobians.data());
    system->information += d_point.transpose() * d_point;
    const int row = result_.camera_rows_[observation.camera];
    if (row < 0) return;
    reduced_.block<6, 6>(row, row) += d_camera.transpose() * d_camera;
    system->couplings.emplace_back(row, d_point.transpose() * d_camera);
  }

  void AddDistances() {
    for (const DistancePrior& prior : problem_.distances) {
      const std::array<double, 6> zero{};
      const std::array<const double*, 2> blocks = {zero.data(), zero.data()};
      const DistanceCost cost(&references_[prior.camera_a], &references_[prior.camera_b],
                              prior.distance, prior.sigma_log);
      double residual = 0;
      Eigen::Matrix<double, 1, 6> d_a, d_b;
      std::array<double*, 2> jacobians = {d_a.data(), d_b.data()};
      cost.Evaluate(blocks.data(), &residual, jacobians.data());
      Eigen::RowVectorXd row = Eigen::RowVectorXd::Zero(rows_);
      const int a = result_.camera_rows_[prior.camera_a];
      const int b = result_.camera_rows_[prior.camera_b];
      if (a >= 0) row.segment<6>(a) += d_a;
      if (b >= 0) row.segment<6>(b) += d_b;
      reduced_ += row.transpose() * row;
    }
  }

  // Unit information on the direction in which all positions grow together.
  void HoldScale() {
    for (size_t i = 0; i < systems_.size(); ++i) {
      if (problem_.points[i].fixed && systems_[i].count >= 2) return;
    }
    if (!problem_.distances.empty()) return;
    Eigen::VectorXd direction = Eigen::VectorXd::Zero(rows_);
    const Eigen::Vector3d origin = problem_.cameras[0].world_from_camera.translation;
    for (size_t i = 0; i < references_.size(); ++i) {
      const int row = result_.camera_rows_[i];
      if (row < 0) continue;
      const Rigid3& pose = references_[i].world_from_camera;
      direction.segment<3>(row) = pose.rotation.conjugate() * (pose.translation - origin);
    }
    const double norm2 = direction.squaredNorm();
    if (norm2 <= 0) return;
    // The relative change of the scale is direction' d / norm2.
    const double median_depth = MedianDepth(problem_);
    const double sigma =
        kHeldScaleSigma + kHeldScaleSigmaOfDepth * median_depth * median_depth / norm2;
    direction /= norm2 * sigma;
    reduced_ += direction * direction.transpose();
  }

  void EliminatePoints() {
    for (size_t i = 0; i < systems_.size(); ++i) {
      PointSystem& system = systems_[i];
      if (system.count < 2) continue;
      BundleCovariance::PointBlock& block = result_.points_[i];
      block.rows.reserve(system.couplings.size() + 1);
      if (problem_.points[i].fixed) {
        block.rows.push_back({0, Eigen::Matrix<double, 3, 6>::Zero()});
        continue;
      }
      block.conditional = system.information.inverse();
      block.d_point = system.reference.PointJacobian(system.parameters.data(), min_rho_);
      for (const auto& [row, coupling] : system.couplings) {
        block.rows.push_back({row, block.conditional * coupling});
      }
      for (const auto& [row, coupling] : system.couplings) {
        for (const auto& other : block.rows) {
          reduced_.block<6, 6>(row, other.row) -= coupling.transpose() * other.weights;
        }
      }
      if (block.rows.empty()) block.rows.push_back({0, Eigen::Matrix<double, 3, 6>::Zero()});
    }
  }

  const BundleProblem& problem_;
  BundleCovariance result_;
  std::vector<CameraReference> references_;
  std::vector<PointSystem> systems_;
  Eigen::MatrixXd reduced_;
  int rows_ = 0;
  double min_rho_ = 0;
};

std::optional<BundleCovariance> BundleCovariance::Compute(const BundleProblem& problem) {
  return BundleCovarianceBuilder(problem).Run();
}

Matrix6d BundleCovariance::Camera(int camera) const {
  const int row = camera_rows_[camera];
  if (row < 0) return Matrix6d::Zero();
  return camera_covariance_.block<6, 6>(row, row);
}

// A point is -H_pp^-1 H_pc c plus its own, conditional part.
Eigen::MatrixXd BundleCovariance::PointCameras(int point) const {
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(3, camera_covariance_.cols());
  if (camera_covariance_.cols() == 0) return result;
  for (const Coupling& coupling : points_[point].rows) {
    result -= coupling.weights * camera_covariance_.middleRows<6>(coupling.row);
  }
  return result;
}

Eigen::Matrix3d BundleCovariance::Point(int point) const {
  const PointBlock& block = points_[point];
  Eigen::Matrix3d covariance = block.conditional;
  if (camera_covariance_.cols() > 0) {
    for (const Coupling& a : block.rows) {
      for (const Coupling& b : block.rows) {
        covariance +=
            a.weights * camera_covariance_.block<6, 6>(a.row, b.row) * b.weights.transpose();
      }
    }
  }
  covariance = block.d_point * covariance * block.d_point.transpose();
  return 0.5 * (covariance + covariance.transpose());
}

Eigen::MatrixXd BundleCovariance::Joint(const std::vector<int>& points, int camera) const {
  const int size = 3 * static_cast<int>(points.size());
  Eigen::MatrixXd joint = Eigen::MatrixXd::Zero(size + 6, size + 6);
  joint.bottomRightCorner<6, 6>() = Camera(camera);
  for (size_t i = 0; i < points.size(); ++i) {
    const PointBlock& a = points_[points[i]];
    const Eigen::MatrixXd cameras = PointCameras(points[i]);
    for (size_t j = i; j < points.size(); ++j) {
      const PointBlock& b = points_[points[j]];
      Eigen::Matrix3d block = i == j ? a.conditional : Eigen::Matrix3d::Zero();
      if (cameras.cols() > 0) {
        for (const Coupling& coupling : b.rows) {
          block -= cameras.middleCols<6>(coupling.row) * coupling.weights.transpose();
        }
      }
      block = a.d_point * block * b.d_point.transpose();
      joint.block<3, 3>(3 * i, 3 * j) = block;
      joint.block<3, 3>(3 * j, 3 * i) = block.transpose();
    }
    if (camera_rows_[camera] < 0) continue;
    const Eigen::Matrix<double, 3, 6> with_camera =
        a.d_point * cameras.middleCols<6>(camera_rows_[camera]);
    joint.block<3, 6>(3 * i, size) = with_camera;
    joint.block<6, 3>(size, 3 * i) = with_camera.transpose();
  }
  return joint;
}

}  // namespace portolan
