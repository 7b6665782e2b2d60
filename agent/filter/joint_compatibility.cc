#include "agent/filter/joint_compatibility.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "common/linear_algebra/dense.h"

namespace portolan {
namespace {

double NormalQuantile(double probability) {
  double low = 0, high = 40;
  for (int i = 0; i < 60; ++i) {
    const double middle = 0.5 * (low + high);
    (0.5 * std::erfc(-middle / std::sqrt(2.0)) < probability ? low : high) = middle;
  }
  return low;
}

}  // namespace

double ChiSquareQuantile(double probability, int degrees_of_freedom) {
  const double spread = 2.0 / (9.0 * degrees_of_freedom);
  const double root = 1 - spread + NormalQuantile(probability) * std::sqrt(spread);
  return degrees_of_freedom * root * root * root;
}

JointCompatibility::JointCompatibility(const FilterOptions& options) : options_(options) {
  const int most = options.max_landmarks;
  limits_.resize(most + 1, 0);
  for (int i = 1; i <= most; ++i) {
    limits_[i] = ChiSquareQuantile(options.joint_probability, 2 * i);
  }
}

void JointCompatibility::Arrange(std::span<const LinearMeasurement> linear,
                                 const Eigen::Ref<const Eigen::MatrixXd>& pht,
                                 const FilterState& state) {
  const int count = static_cast<int>(linear.size());
  order_.resize(count);
  std::iota(order_.begin(), order_.end(), 0);
  own_covariances_.resize(count);
  own_distances_.resize(count);
  for (int i = 0; i < count; ++i) {
    own_covariances_[i] = PredictedCovariance(state, linear[i]);
    own_covariances_[i].diagonal().array() += linear[i].variance;
    own_distances_[i] =
        linear[i].innovation.dot(own_covariances_[i].inverse() * linear[i].innovation);
  }
  std::stable_sort(order_.begin(), order_.end(),
                   [this](int a, int b) { return own_distances_[a] < own_distances_[b]; });
  covariance_.resize(2 * count, 2 * count);
  innovation_.resize(2 * count);
  for (int i = 0; i < count; ++i) {
    innovation_.segment<2>(2 * i) = linear[order_[i]].innovation;
    for (int j = 0; j < i; ++j) {
      covariance_.block<2, 2>(2 * i, 2 * j) = TimesPHt(linear[order_[i]], pht, order_[j]);
    }
    covariance_.block<2, 2>(2 * i, 2 * i) = own_covariances_[order_[i]];
  }
}

std::optional<double> JointCompatibility::DistanceWith(int match, double distance) {
  const int rows = 2 * static_cast<int>(chosen_.size());
  auto own = factor_.block(rows, 0, 2, rows);
  for (size_t i = 0; i < chosen_.size(); ++i) {
    own.middleCols<2>(2 * i) = covariance_.block<2, 2>(2 * match, 2 * chosen_[i]);
  }
  // The new rows of L: S_new,chosen L^-T, then the factor of what is left of the diagonal block.
  auto own_transposed = own.transpose();
  factor_.topLeftCorner(rows, rows).triangularView<Eigen::Lower>().solveInPlace(own_transposed);
  Eigen::Matrix2d left = covariance_.block<2, 2>(2 * match, 2 * match);
  left.noalias() -= own * own.transpose();
  const Eigen::Matrix2d l = CholeskyFactor(left);
  if (!(l(1, 1) > 0)) return std::nullopt;
  factor_.block<2, 2>(rows, rows) = l;
  Eigen::Vector2d rest = innovation_.segment<2>(2 * match);
  rest.noalias() -= own * whitened_.head(rows);
  whitened_.segment<2>(rows) = l.inverse() * rest;
  return distance + whitened_.segment<2>(rows).squaredNorm();
}

void JointCompatibility::Branch(int level, double distance) {
  const int left = static_cast<int>(order_.size()) - level;
  if (chosen_.size() > best_.size()) best_ = chosen_;
  if (left == 0 || chosen_.size() + left <= best_.size()) return;
  if (nodes_ >= options_.joint_max_nodes) return;
  ++nodes_;
  const auto joint = DistanceWith(level, distance);
  if (joint && *joint < limits_[chosen_.size() + 1]) {
    chosen_.push_back(level);
    Branch(level + 1, *joint);
    chosen_.pop_back();
  }
  Branch(level + 1, distance);
}

InlierSet JointCompatibility::Select(std::span<const Match> matches,
                                     std::span<const LinearMeasurement> linear,
                                     const Eigen::Ref<const Eigen::MatrixXd>& pht,
                                     const FilterState& state, const CameraModel&) {
  Arrange(linear, pht, state);
  factor_.resize(2 * matches.size(), 2 * matches.size());
  whitened_.resize(2 * matches.size());
  chosen_.clear();
  best_.clear();
  nodes_ = 0;
  Branch(0, 0);
  InlierSet inliers;
  inliers.hypotheses = nodes_;
  for (int position : best_) inliers.matches.push_back(order_[position]);
  std::sort(inliers.matches.begin(), inliers.matches.end());
  return inliers;
}

}  // namespace portolan
