#include "agent/filter/known_depths.h"

#include <cmath>

namespace portolan {

MeanDepth MeanOfKnownDepths(const FilterState& state, double max_sigma_ratio) {
  const auto covariance = state.covariance();
  const Rigid3 camera_pose = state.motion().submap_from_camera();
  MeanDepth mean;
  mean.d_log_d_state = Eigen::RowVectorXd::Zero(state.dim());
  Eigen::RowVector3d d_camera = Eigen::RowVector3d::Zero();
  for (const Landmark& landmark : state.landmarks()) {
    const int offset = state.Offset(landmark);
    Eigen::RowVector3d d_log(0, 0, 1.0 / landmark.inverse_depth);
    Eigen::Vector3d direction =
        DirectionInCamera(landmark, state.AnchorPosition(landmark), camera_pose);
    double log_inverse_depth = -std::log(direction.norm());
    if (landmark.euclidean) {
      d_log = -(camera_pose.rotation * direction).transpose() / direction.squaredNorm();
    } else {
      if (landmark.inverse_depth <= 0) continue;
      log_inverse_depth += std::log(landmark.inverse_depth);
    }
    const double variance = d_log * covariance.block<3, 3>(offset, offset) * d_log.transpose();
    if (variance > max_sigma_ratio * max_sigma_ratio) continue;
    mean.log_inverse_depth += log_inverse_depth;
    mean.d_log_d_state.segment<3>(offset) = d_log;
    if (landmark.euclidean) d_camera -= d_log;
    ++mean.count;
  }
  if (mean.count == 0) return mean;
  mean.d_log_d_state.head<6>() = d_camera * state.motion().DCameraDPose().topRows<3>();
  mean.d_log_d_state /= mean.count;
  mean.log_inverse_depth /= mean.count;
  return mean;
}

}  // namespace portolan
