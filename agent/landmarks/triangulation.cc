#include "agent/landmarks/triangulation.h"

#include <Eigen/Geometry>
#include <Eigen/SVD>
#include <cmath>

#include "common/linear_algebra/dense.h"

namespace portolan {
namespace {

constexpr int kMaxIterations = 15;
constexpr double kMaxDamping = 1e8;

Eigen::Matrix<double, 3, 2> TangentsOf(const Eigen::Vector3d& unit) {
  Eigen::Matrix<double, 3, 2> tangents;
  tangents.col(0) = unit.unitOrthogonal();
  tangents.col(1) = unit.cross(tangents.col(0));
  return tangents;
}

// Normal equations of all views and of the reference's own bearing.
struct NormalEquations {
  Eigen::Matrix3d h = Eigen::Matrix3d::Zero();
  Eigen::Vector3d g = Eigen::Vector3d::Zero();
  double cost = 0;
};

std::optional<NormalEquations> Accumulate(const InverseDepthPoint& point,
                                          std::span<const BearingView> views) {
  NormalEquations sum;
  const auto add = [&](const BearingView& view) {
    const auto residual = ResidualOf(view, point);
    if (!residual) return false;
    sum.h += residual->d_point.transpose() * residual->d_point;
    sum.g += residual->d_point.transpose() * residual->value;
    sum.cost += residual->value.squaredNorm();
    return true;
  };
  bool all = add({Rigid3::Identity(), point.ray});
  for (const BearingView& view : views) all = all && add(view);
  if (!all) return std::nullopt;
  return sum;
}

}  // namespace

InverseDepthPoint MakeInverseDepthPoint(const Eigen::Vector3d& ray, double inverse_depth) {
  return {ray, TangentsOf(ray), {0, 0, inverse_depth}};
}

std::optional<BearingResidual> ResidualOf(const BearingView& view, const InverseDepthPoint& point) {
  const Eigen::Matrix3d rotation = view.camera_from_reference.rotation.toRotationMatrix();
  const Eigen::Vector3d direction =
      rotation * point.Direction() + point.value.z() * view.camera_from_reference.translation;
  const double norm = direction.norm();
  if (!(norm > 1e-9) || view.bearing.dot(direction) <= 0) return std::nullopt;
  const Eigen::Vector3d unit = direction / norm;
  const Eigen::Matrix<double, 3, 2> tangents = TangentsOf(view.bearing);
  Eigen::Matrix3d d_direction;
  d_direction.leftCols<2>() = rotation * point.tangents;
  d_direction.col(2) = view.camera_from_reference.translation;
  BearingResidual residual;
  residual.value = tangents.transpose() * unit;
  residual.d_point = tangents.transpose() *
                     (Eigen::Matrix3d::Identity() - unit * unit.transpose()) * d_direction / norm;
  return residual;
}

std::optional<double> InverseDepthByDlt(const Eigen::Vector3d& bearing_in_reference,
                                        const BearingView& other) {
  const Eigen::Matrix3d rotation = other.camera_from_reference.rotation.toRotationMatrix();
  const Eigen::Vector3d& translation = other.camera_from_reference.translation;
  // Scaled by the baseline, so that the homogeneous coordinate is of the size of the others.
  const double baseline = translation.norm();
  if (!(baseline > 1e-12)) return std::nullopt;
  Eigen::Matrix<double, 4, 4> rows;
  const Eigen::Matrix<double, 2, 3> own = TangentsOf(bearing_in_reference).transpose();
  const Eigen::Matrix<double, 2, 3> others = TangentsOf(other.bearing).transpose();
  rows.topRows<2>() << own, Eigen::Vector2d::Zero();
  rows.bottomRows<2>() << others * rotation, others * translation / baseline;
  const Eigen::JacobiSVD<Eigen::Matrix4d> svd(rows, Eigen::ComputeFullV);
  const Eigen::Vector4d homogeneous = svd.matrixV().col(3);
  if (std::abs(homogeneous.w()) < 1e-9) return std::nullopt;
  const Eigen::Vector3d point = baseline * homogeneous.head<3>() / homogeneous.w();
  const double depth = point.dot(bearing_in_reference);
  if (!(depth > 0) || other.bearing.dot(rotation * point + translation) <= 0) return std::nullopt;
  return 1 / depth;
}

std::optional<double> InverseDepthSigma(const InverseDepthPoint& point,
                                        std::span<const BearingView> views, double sigma_rad) {
  const auto sum = Accumulate(point, views);
  if (!sum) return std::nullopt;
  // The inverse depth given the free direction: Schur complement.
  const Eigen::Matrix2d h_direction = sum->h.topLeftCorner<2, 2>();
  const Eigen::Vector2d cross = sum->h.topRightCorner<2, 1>();
  const double information = sum->h(2, 2) - cross.dot(h_direction.inverse() * cross);
  if (!(information > 0)) return std::nullopt;
  return sigma_rad / std::sqrt(information);
}

std::optional<DepthEstimate> InverseDepthByLevenbergMarquardt(
    const Eigen::Vector3d& bearing_in_reference, double start_inverse_depth,
    std::span<const BearingView> views, double sigma_rad) {
  InverseDepthPoint point = MakeInverseDepthPoint(bearing_in_reference, start_inverse_depth);
  auto sum = Accumulate(point, views);
  double damping = 1e-3;
  bool converged = false;
  for (int i = 0; sum && !converged && i < kMaxIterations && damping < kMaxDamping; ++i) {
    Eigen::Matrix3d h = sum->h;
    h.diagonal() += damping * sum->h.diagonal() + Eigen::Vector3d::Constant(1e-15);
    Eigen::Vector3d step = -sum->g;
    SolveSymmetric(h, step);
    InverseDepthPoint next = point;
    next.value += step;
    const auto next_sum = Accumulate(next, views);
    if (!next_sum || !(next_sum->cost <= sum->cost)) {
      damping *= 10;
      continue;
    }
    converged = std::abs(step.z()) < 1e-6 * std::abs(next.value.z()) ||
                sum->cost - next_sum->cost < 1e-9 * sum->cost;
    point = next;
    sum = next_sum;
    damping *= 0.1;
  }
  if (!sum || !(point.value.z() > 0)) return std::nullopt;
  const auto sigma = InverseDepthSigma(point, views, sigma_rad);
  if (!sigma) return std::nullopt;
  return DepthEstimate{point.value.z(), *sigma};
}

}  // namespace portolan
