#include "agent/filter/inlier_selector.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace portolan {
namespace {

// Squared residual of a match over its variance, were the error added to the state.
double ResidualAt(const Match& match, const LinearMeasurement& linear, const FilterState& state,
                  const Eigen::VectorXd& error, const Rigid3& camera_pose,
                  const CameraModel& camera) {
  Landmark landmark = state.landmarks()[match.landmark];
  Eigen::Vector3d anchor = state.AnchorPosition(landmark);
  if (linear.anchor_offset != FilterState::kFixed) {
    anchor += error.segment<3>(linear.anchor_offset);
  }
  // First order is enough here: the correction of a ray by another landmark's match is tiny.
  const Eigen::Vector3d own = error.segment<3>(linear.landmark_offset);
  if (landmark.euclidean) {
    landmark.point_in_submap += own;
  } else {
    landmark.ray_frame.col(2) += landmark.ray_frame.leftCols<2>() * own.head<2>();
    landmark.inverse_depth += own(2);
  }
  const auto pixel = ProjectLandmark(landmark, anchor, camera_pose, camera);
  if (!pixel.has_value()) return std::numeric_limits<double>::infinity();
  return (match.pixel - *pixel).squaredNorm() / linear.variance;
}

}  // namespace

OnePointRansac::OnePointRansac(const FilterOptions& options)
    : options_(options), random_(options.ransac_seed) {}

int OnePointRansac::HypothesesNeeded(double inlier_share) const {
  if (inlier_share >= 1) return 1;
  if (inlier_share <= 0) return options_.ransac_max_hypotheses;
  const double needed =
      std::log(1 - options_.ransac_success_probability) / std::log(1 - inlier_share);
  return std::min(options_.ransac_max_hypotheses, static_cast<int>(std::ceil(needed)));
}

InlierSet OnePointRansac::Select(std::span<const Match> matches,
                                 std::span<const LinearMeasurement> linear,
                                 const Eigen::Ref<const Eigen::MatrixXd>& pht,
                                 const FilterState& state, const CameraModel& camera) {
  const int count = static_cast<int>(matches.size());
  std::vector<int> order(count);
  std::iota(order.begin(), order.end(), 0);
  InlierSet best;
  std::vector<int> support;
  support.reserve(count);
  int needed = std::min(count, options_.ransac_max_hypotheses);
  int tried = 0;
  for (; tried < needed; ++tried) {
    // Fisher-Yates step by hand: std::shuffle's use of the engine differs between libraries.
    std::swap(order[tried], order[tried + random_() % (count - tried)]);
    const int i = order[tried];
    Eigen::Matrix2d s = TimesPHt(linear[i], pht, i);
    s.diagonal().array() += linear[i].variance;
    correction_.noalias() = pht.middleCols(2 * i, 2) * (s.inverse() * linear[i].innovation);
    const Rigid3 camera_pose = state.motion().CorrectedCamera(correction_.head<6>());
    support.clear();
    for (int j = 0; j < count; ++j) {
      if (j == i || ResidualAt(matches[j], linear[j], state, correction_, camera_pose, camera) <
                        options_.low_innovation_chi2) {
        support.push_back(j);
      }
    }
    if (support.size() > best.matches.size()) {
      best.matches.swap(support);
      needed = std::min(
          needed,
          std::max(tried + 1, HypothesesNeeded(static_cast<double>(best.matches.size()) / count)));
    }
  }
  best.hypotheses = tried;
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
    case InlierSelection::kOnePointRansac:
      break;
  }
  return std::make_unique<OnePointRansac>(options);
}

}  // namespace portolan
