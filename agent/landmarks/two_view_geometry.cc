#include "agent/landmarks/two_view_geometry.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <vector>

#include "common/linear_algebra/dense.h"

namespace portolan {
namespace {

// Five degrees of freedom: rotation, and the translation's direction along two tangents.
void Refine(std::span<const BearingPair> pairs, double limit_rad, Rigid3* pose) {
  constexpr int kIterations = 6;
  for (int i = 0; i < kIterations; ++i) {
    Eigen::Matrix<double, 3, 2> tangents;
    tangents.col(0) = pose->translation.unitOrthogonal();
    tangents.col(1) = pose->translation.cross(tangents.col(0));
    Eigen::Matrix<double, 5, 5> h = 1e-9 * Eigen::Matrix<double, 5, 5>::Identity();
    Eigen::Matrix<double, 5, 1> g = Eigen::Matrix<double, 5, 1>::Zero();
    for (const BearingPair& pair : pairs) {
      const EpipolarResidual residual = EpipolarResidualOf(*pose, pair);
      const double sine = std::max(residual.sine, 1e-3);
      if (std::abs(residual.value) > limit_rad * sine) continue;
      Eigen::Matrix<double, 1, 5> row;
      row << residual.d_rotation / sine, residual.d_translation * tangents / sine;
      h += row.transpose() * row;
      g += row.transpose() * residual.value / sine;
    }
    Eigen::Matrix<double, 5, 1> step = -g;
    SolveSymmetric(h, step);
    if (!step.allFinite()) return;
    const Eigen::Vector3d turn = step.head<3>();
    pose->rotation = (pose->rotation * RotationExp(turn)).normalized();
    pose->translation = (pose->translation + tangents * step.tail<2>()).normalized();
  }
}

}  // namespace

EpipolarResidual EpipolarResidualOf(const Rigid3& second_from_first, const BearingPair& pair) {
  const Eigen::Vector3d turned = second_from_first.rotation * pair.in_first;
  const Eigen::Vector3d normal = second_from_first.translation.cross(turned);
  EpipolarResidual residual;
  residual.value = pair.in_second.dot(normal);
  // R Exp(w) b1 = R (b1 + w x b1), and the scalar triple product in turn.
  const Eigen::Vector3d across = pair.in_second.cross(second_from_first.translation);
  residual.d_rotation =
      pair.in_first.cross(second_from_first.rotation.conjugate() * across).transpose();
  residual.d_translation = turned.cross(pair.in_second).transpose();
  residual.sine = normal.norm();
  return residual;
}

std::optional<Rigid3> PoseOfTwoViews(std::span<const BearingPair> pairs, double sigma_rad) {
  constexpr double kMinCosine = 0.17;
  constexpr size_t kMinPairs = 10;
  std::vector<cv::Point2d> first, second;
  for (const BearingPair& pair : pairs) {
    if (pair.in_first.z() < kMinCosine || pair.in_second.z() < kMinCosine) continue;
    first.emplace_back(pair.in_first.x() / pair.in_first.z(),
                       pair.in_first.y() / pair.in_first.z());
    second.emplace_back(pair.in_second.x() / pair.in_second.z(),
                        pair.in_second.y() / pair.in_second.z());
  }
  if (first.size() < kMinPairs) return std::nullopt;
  try {
    cv::Mat inliers, rotation, translation;
    const cv::Mat essential = cv::findEssentialMat(first, second, cv::Mat::eye(3, 3, CV_64F),
                                                   cv::RANSAC, 0.999, 3 * sigma_rad, inliers);
    if (essential.rows != 3 || essential.cols != 3) return std::nullopt;
    const int support = cv::recoverPose(essential, first, second, cv::Mat::eye(3, 3, CV_64F),
                                        rotation, translation, inliers);
    if (2 * static_cast<size_t>(support) < first.size()) return std::nullopt;
    Eigen::Matrix3d matrix;
    Rigid3 pose;
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) matrix(i, j) = rotation.at<double>(i, j);
      pose.translation(i) = translation.at<double>(i);
    }
    pose.rotation = Eigen::Quaterniond(matrix).normalized();
    if (!matrix.allFinite() || !pose.translation.allFinite()) return std::nullopt;
    Refine(pairs, 3 * sigma_rad, &pose);
    return pose;
  } catch (const cv::Exception&) {
    return std::nullopt;
  }
}

}  // namespace portolan
