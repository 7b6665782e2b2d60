// How a submap whose scale is free becomes metric: by the motion that an IMU has felt, or by laser
// ranges.
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include "agent/agent.h"
#include "agent/agent_measurements.h"
#include "common/base/logging.h"

namespace portolan {

void Agent::SeekScale(Timestamp time) {
  if (ranges_) UseRanges();
  if (!initializer_ || inertial_ || health_.last_frame_bad()) return;
  const std::vector<Measurement> seen = MeasurementsOf(tracker_->points(), [this](TrackId track) {
    return landmarks_.IsLandmark(track) && !landmarks_.WasOutlier(track);
  });
  initializer_->AddFrame(time, filter_->submap_from_camera(), seen);
  const auto found =
      initializer_->Attempt(filter_->Landmarks(), 1.0 / filter_->median_inverse_depth());
  if (!found) return;
  const Rigid3 camera = filter_->submap_from_camera();
  const ImuMount& imu = *sensors_.imu;
  auto model = std::make_unique<ImuMotionModel>(options_.imu.model, imu.calibration,
                                                imu.imu_from_camera, &imu_samples_);
  const Rigid3 metric_camera = {camera.rotation, found->scale * camera.translation};
  model->Set(time, metric_camera * imu.imu_from_camera.Inverse(), found->state);
  filter_->ChangeMotion(std::move(model), ChangeToInertial(*found, camera, imu.imu_from_camera,
                                                           filter_->state().motion_dim()));
  TakeUnit(found->scale);
  if (ranges_) ranges_->Rescale(found->scale);
  inertial_ = true;
  LogInfo("IMU aligned: one unit was ", found->scale, " m (+-",
          100 * std::sqrt(found->covariance(0, 0)), " %)");
}

void Agent::UseRanges() {
  if (health_.last_frame_bad()) return;
  const auto scale = ranges_->Use(tracker_->points(), filter_.get());
  if (const auto pixel = ranges_->SpotToFollow()) {
    if (const auto track = tracker_->StartAt(*pixel)) ranges_->Follow(*track);
  }
  if (!scale) return;
  TakeUnit(*scale);
  LogInfo("ranges: one unit was ", *scale, " m (+-", 100 * ranges_->scale_sigma(), " %)");
}

void Agent::TakeUnit(double scale) {
  builder_.Rescale(scale);
  depths_.Rescale(scale);
  track_places_.Rescale(scale);
  found_scale_ = true;
  link_keeps_units_ = false;
}

void Agent::CorrectScale() {
  if (!ranges_) return;
  const double scale = ranges_->CorrectScale(filter_.get());
  if (scale == 1) return;
  builder_.Rescale(scale);
  depths_.Rescale(scale);
  track_places_.Rescale(scale);
}

}  // namespace portolan
