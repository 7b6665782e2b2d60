// How an image's tracks are found: the landmarks tell the motion, by which the others are looked
// for, those that were lost as well.
#include <algorithm>
#include <utility>
#include <vector>

#include "agent/agent.h"
#include "common/base/check.h"

namespace portolan {
namespace {

bool IsLive(const std::vector<TrackedPoint>& points, TrackId track) {
  const auto it = std::lower_bound(
      points.begin(), points.end(), track,
      [](const TrackedPoint& point, TrackId wanted) { return point.track < wanted; });
  return it != points.end() && it->track == track;
}

}  // namespace

void Agent::TrackLandmarks(Timestamp time, const cv::Mat& gray) {
  before_ = filter_->submap_from_camera();
  filter_->Predict(time);
  predicted_ = filter_->PredictMeasurements();
  std::vector<TrackPrediction> predictions;
  predictions.reserve(predicted_.size());
  for (const auto& prediction : predicted_) {
    predictions.push_back({prediction.track, prediction.pixel, prediction.innovation_covariance});
  }
  const Eigen::Quaterniond before_from_now =
      before_.rotation.conjugate() * filter_->submap_from_camera().rotation;
  // CheckFrame has seen to what is refused.
  PORTOLAN_CHECK(tracker_->TrackPredicted(gray, predictions, before_from_now).ok());
  std::vector<SearchRegion> lost;
  for (const auto& prediction : predicted_) {
    if (!IsLive(tracker_->points(), prediction.track)) {
      lost.push_back({prediction.track, prediction.pixel, prediction.innovation_covariance});
    }
  }
  if (!lost.empty()) tracker_->Reacquire(lost);
}

int Agent::UpdateFilter() {
  std::vector<Measurement> measurements;
  for (const TrackedPoint& point : tracker_->points()) {
    if (!landmarks_.IsLandmark(point.track)) continue;
    measurements.push_back({point.track, point.pixel, point.sigma_px});
  }
  const UpdateResult update = filter_->Update(measurements);
  Remove(landmarks_.Report(predicted_, update));
  landmarks_.Remove(update.dropped);  // the filter has let go of these itself
  measured_ = static_cast<int>(update.inliers.size());
  return measured_;
}

void Agent::TrackOthers() {
  const Rigid3 camera = filter_->submap_from_camera();
  std::vector<TrackPrediction> predictions;
  if (measured_ >= options_.lost_tracks.min_landmarks) {
    predictions = lost_tracks_.PredictLive(camera);
  }
  tracker_->TrackOthers(predictions, before_.rotation.conjugate() * camera.rotation);
  depths_.AddFrame(camera, tracker_->points());
}

void Agent::AddTrackedKeyframe(Timestamp time) {
  const Rigid3 camera = filter_->submap_from_camera();
  tracker_->Reacquire(lost_tracks_.Expect(camera, tracker_->points()));
  AddKeyframe(time);
  std::vector<TrackId> slipped = lost_tracks_.AddKeyframe(camera, UsablePoints());
  // The filter sees to its landmarks itself.
  std::erase_if(slipped, [this](TrackId track) { return landmarks_.IsLandmark(track); });
  tracker_->Drop(slipped);
}

}  // namespace portolan
