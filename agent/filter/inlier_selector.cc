#include "agent/filter/inlier_selector.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>

#include "agent/filter/joint_compatibility.h"
#include "common/linear_algebra/dense.h"

namespace portolan {
namespace {

// Residual of a match, were the error added to the state; no value if it does not project.
std::optional<Eigen::Vector2d> ResidualAt(const Match& match, const LinearMeasurement& linear,
                                          const FilterState& state, const Eigen::VectorXd& error,
                                          const Rigid3& camera_pose, const CameraModel& camera) {
  Landmark landmark = state.landmarks()[match.landmark];
  Eigen::Vector3d anchor = state.AnchorPosition(landmark);
  if (linear.anchor_offset != FilterState::kFixed) {
    anchor += error.segment<3>(linear.anchor_offset);
  }
  const Eigen::Vector3d own = error.segment<3>(linear.landmark_offset);
  if (landmark.euclidean) {
    landmark.point_in_submap += own;
  } else {
    // First order is enough: rays are known to a few pixels.
    landmark.ray_frame.col(2) += landmark.ray_frame.leftCols<2>() * own.head<2>();
    landmark.inverse_depth += own(2);
  }
  const auto pixel = ProjectLandmark(landmark, anchor, camera_pose, camera);
  if (!pixel.has_value()) return std::nullopt;
  return match.pixel - *pixel;
}

}  // namespace

OnePointRansac::OnePointRansac(const FilterOptions& options)
    : options_(options), random_(options.ransac_seed) {}

int OnePointRansac::HypothesesNeeded(double inlier_share) const {
  const double clean = std::pow(inlier_share, size_);
  if (clean >= 1) return 1;
  const double needed = std::log(1 - options_.ransac_success_probability) / std::log1p(-clean);
  return needed < options_.ransac_max_hypotheses ? static_cast<int>(std::ceil(needed))
                                                 : options_.ransac_max_hypotheses;
}

void OnePointRansac::AddPoint(const Problem& problem, int point) {
  const int done = 2 * size_, n = static_cast<int>(problem.pht.rows());
  const Eigen::Matrix<double, 2, 2 * kMaxPoints> own = whitened_rows_[point];
  const Eigen::Matrix2d l = CholeskyFactor(ConditionalCovariance(problem, point));
  const Eigen::Matrix2d l_inverse_transposed = l.inverse().transpose();
  whitened_innovation_.segment<2>(done) =
      l_inverse_transposed.transpose() *
      (problem.linear[point].innovation - own.leftCols(done) * whitened_innovation_.head(done));
  auto gain = whitened_gain_.middleCols<2>(done);
  gain = problem.pht.middleCols<2>(2 * point);
  gain.noalias() -= whitened_gain_.leftCols(done).lazyProduct(own.leftCols(done).transpose());
  gain = (gain * l_inverse_transposed).eval();
  for (size_t j = 0; j < problem.matches.size(); ++j) {
    auto& row = whitened_rows_[j];
    const Eigen::Matrix2d cross = TimesPHt(problem.linear[j], problem.pht, point) -
                                  row.leftCols(done) * own.leftCols(done).transpose();
    row.middleCols<2>(done) = cross * l_inverse_transposed;
  }
  points_[size_++] = point;
  correction_.head(n).noalias() =
      whitened_gain_.leftCols(done + 2) * whitened_innovation_.head(done + 2);
}

Eigen::Matrix2d OnePointRansac::ConditionalCovariance(const Problem& problem, int j) const {
  const auto row = whitened_rows_[j].leftCols(2 * size_);
  Eigen::Matrix2d covariance = prior_covariances_[j] - row * row.transpose();
  const LinearMeasurement& linear = problem.linear[j];
  if (linear.d_pixel_d_shift.isZero(0)) return covariance;
  // Second moment of the way from the anchor, given the hypothesis.
  Eigen::Matrix3d shift = prior_shifts_[j];
  if (size_ > 0) {
    auto gain = whitened_gain_.topLeftCorner(3, 2 * size_).eval();
    Eigen::Vector3d way = correction_.head<3>();
    if (linear.anchor_offset != FilterState::kFixed) {
      gain -= whitened_gain_.block(linear.anchor_offset, 0, 3, 2 * size_);
      way -= correction_.segment<3>(linear.anchor_offset);
    }
    shift += way * way.transpose();
    AddProductTransposed(-1, gain, gain, shift);
  }
  return covariance + DepthShiftCovariance(problem.state, linear, shift);
}

bool OnePointRansac::IsDetermined(const Problem& problem) {
  variances_.clear();
  for (size_t j = 0; j < problem.matches.size(); ++j) {
    variances_.push_back(0.5 * ConditionalCovariance(problem, j).trace() /
                         problem.linear[j].variance);
  }
  const auto middle = variances_.begin() + variances_.size() / 2;
  std::nth_element(variances_.begin(), middle, variances_.end());
  return *middle < options_.ransac_conditional_variance;
}

void OnePointRansac::DrawHypothesis(const Problem& problem) {
  const int count = static_cast<int>(problem.matches.size());
  size_ = 0;
  while (size_ < std::min(kMaxPoints, count)) {
    // The engine alone is used: the standard's distributions differ between libraries.
    const int point = static_cast<int>(random_() % count);
    if (std::find(points_, points_ + size_, point) != points_ + size_) continue;
    AddPoint(problem, point);
    if (IsDetermined(problem)) break;
  }
}

void OnePointRansac::FindSupport(const Problem& problem) {
  const Rigid3 camera_pose = problem.state.motion().CorrectedCamera(correction_.head<6>());
  support_.clear();
  for (int j = 0; j < static_cast<int>(problem.matches.size()); ++j) {
    if (std::find(points_, points_ + size_, j) != points_ + size_) {
      support_.push_back(j);
      continue;
    }
    const auto residual = ResidualAt(problem.matches[j], problem.linear[j], problem.state,
                                     correction_, camera_pose, problem.camera);
    if (residual && residual->dot(ConditionalCovariance(problem, j).inverse() * *residual) <
                        options_.low_innovation_chi2) {
      support_.push_back(j);
    }
  }
}

InlierSet OnePointRansac::Select(std::span<const Match> matches,
                                 std::span<const LinearMeasurement> linear,
                                 const Eigen::Ref<const Eigen::MatrixXd>& pht,
                                 const FilterState& state, const CameraModel& camera) {
  const Problem problem{matches, linear, pht, state, camera};
  const int count = static_cast<int>(matches.size());
  prior_covariances_.resize(count);
  prior_shifts_.resize(count);
  whitened_rows_.resize(count);
  whitened_gain_.resize(pht.rows(), Eigen::NoChange);
  correction_.resize(pht.rows());
  for (int j = 0; j < count; ++j) {
    prior_shifts_[j] = ShiftCovariance(state, linear[j]);
    prior_covariances_[j] = LinearCovariance(state, linear[j]);
    prior_covariances_[j].diagonal().array() += linear[j].variance;
  }
  InlierSet best;
  int needed = options_.ransac_max_hypotheses;
  for (; best.hypotheses < needed; ++best.hypotheses) {
    DrawHypothesis(problem);
    FindSupport(problem);
    if (support_.size() <= best.matches.size()) continue;
    best.matches.swap(support_);
    needed = std::min(needed, HypothesesNeeded(static_cast<double>(best.matches.size()) / count));
  }
  return best;
}

InlierSet ChiSquareOnly::Select(std::span<const Match> matches, std::span<const LinearMeasurement>,
                                const Eigen::Ref<const Eigen::MatrixXd>&, const FilterState&,
                                const CameraModel&) {
  InlierSet all;
  all.matches.resize(matches.size());
  std::iota(all.matches.begin(), all.matches.end(), 0);
  return all;
}

std::unique_ptr<InlierSelector> MakeInlierSelector(const FilterOptions& options) {
  switch (options.inlier_selection) {
    case InlierSelection::kChiSquareOnly:
      return std::make_unique<ChiSquareOnly>();
    case InlierSelection::kJointCompatibility:
      return std::make_unique<JointCompatibility>(options);
    case InlierSelection::kOnePointRansac:
      break;
  }
  return std::make_unique<OnePointRansac>(options);
}

}  // namespace portolan
