// LocalFilter's part for sensors that measure a length now and then.
#include <utility>

#include "agent/filter/known_depths.h"
#include "agent/filter/local_filter.h"
#include "common/base/check.h"
#include "common/linear_algebra/dense.h"

namespace portolan {

bool LocalFilter::UpdateWithLength(const LengthMeasurement& measurement, double gate_chi2) {
  state_.Expand();
  PORTOLAN_CHECK(measurement.d_state.size() == state_.dim());
  const Eigen::VectorXd row = measurement.d_state.transpose();
  const Eigen::VectorXd pht = Product(state_.covariance(), row);
  const double variance = row.dot(pht) + measurement.variance;
  const double innovation = measurement.innovation;
  if (!(variance > 0 && innovation * innovation <= gate_chi2 * variance)) return false;
  state_.Correct(pht * (innovation / variance));
  auto p = state_.covariance();
  AddProductTransposed(-1 / variance, pht, pht, p);
  Symmetrise(p);
  UpdateMedianInverseDepth();
  PORTOLAN_DCHECK(state_.IsCovarianceValid());
  return true;
}

std::optional<Eigen::RowVectorXd> LocalFilter::DScaleDState() const {
  const MeanDepth mean = MeanOfKnownDepths(state_, options_.known_depth_sigma_ratio);
  if (mean.count < options_.min_known_depths) return std::nullopt;
  return mean.d_log_d_state;
}

bool LocalFilter::TakeScale(double scale) {
  Eigen::VectorXd factors;
  auto motion = state_.motion().Rescaled(scale, &factors);
  const MeanDepth mean = MeanOfKnownDepths(state_, options_.known_depth_sigma_ratio);
  if (metric_depths_ || motion == nullptr || mean.count < options_.min_known_depths) return false;
  // How well the old unit was known says nothing of metres.
  state_.FixScale(mean.d_log_d_state);
  MotionChange change;
  change.scale = scale;
  change.d_new_d_old = factors.asDiagonal();
  change.d_new_d_added = Eigen::MatrixXd::Zero(motion->error_dim(), 1);
  change.added_covariance = Eigen::MatrixXd::Zero(1, 1);
  ChangeMotion(std::move(motion), change);
  has_scale_ = scale_is_trusted_ = true;
  return true;
}

}  // namespace portolan
