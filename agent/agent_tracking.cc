// How an image's tracks are found: the landmarks tell the motion, by which the others are looked
// for, those that were lost as well.
#include <vector>

#include "agent/agent.h"
#include "agent/agent_measurements.h"
#include "common/base/check.h"

namespace portolan {
void Agent::TrackLandmarks(Timestamp time, const cv::Mat& gray) {
  const Eigen::Quaterniond before = filter_->submap_from_camera().rotation;
  filter_->Predict(time);
  before_from_now_ = before.conjugate() * filter_->submap_from_camera().rotation;
  predicted_ = filter_->PredictMeasurements();
  std::vector<TrackPrediction> predictions;
  predictions.reserve(predicted_.size());
  for (const auto& prediction : predicted_) {
    predictions.push_back({prediction.track, prediction.pixel, prediction.innovation_covariance});
  }
  // CheckFrame has seen to what is refused.
  PORTOLAN_CHECK(tracker_->TrackPredicted(gray, predictions, before_from_now_).ok());
  std::vector<SearchRegion> lost;
  for (const auto& prediction : predicted_) {
    if (FindPoint(tracker_->points(), prediction.track) == nullptr) {
      lost.push_back({prediction.track, prediction.pixel, prediction.innovation_covariance});
    }
  }
  if (!lost.empty()) tracker_->Reacquire(lost);
}

void Agent::UpdateFilter() {
  const Eigen::Quaterniond predicted = filter_->submap_from_camera().rotation;
  const UpdateResult update = filter_->Update(MeasurementsOf(
      tracker_->points(), [this](TrackId track) { return landmarks_.IsLandmark(track); }));
  Remove(landmarks_.Report(predicted_, update));
  landmarks_.Remove(update.dropped);  // the filter has let go of these itself
  measured_ = static_cast<int>(update.inliers.size());
  if (filter_->restated()) {
    // What was triangulated with the poses before is of no use; nor is the turn between the two.
    depths_.Reset();
    track_places_.Reset();
  } else {
    before_from_now_ =
        before_from_now_ * predicted.conjugate() * filter_->submap_from_camera().rotation;
  }
}

// While the start is not solved the poses will be taken back.
bool Agent::KnowsPlaces() const {
  return !filter_->starting() && measured_ >= options_.min_landmarks_for_places;
}

void Agent::TrackOthers() {
  const Rigid3 camera = filter_->submap_from_camera();
  std::vector<TrackPrediction> predictions;
  if (KnowsPlaces()) predictions = track_places_.PredictLive(camera);
  tracker_->TrackOthers(predictions, before_from_now_);
  depths_.AddFrame(camera, tracker_->points());
}

void Agent::AddTrackedKeyframe(Timestamp time) {
  if (KnowsPlaces()) {
    const Rigid3 camera = filter_->submap_from_camera();
    tracker_->Reacquire(track_places_.ExpectLost(camera, tracker_->lost()));
    std::vector<TrackId> slipped = track_places_.AddKeyframe(camera, UsablePoints());
    // The filter sees to its landmarks itself.
    std::erase_if(slipped, [this](TrackId track) { return landmarks_.IsLandmark(track); });
    tracker_->Drop(slipped);
  }
  AddKeyframe(time);
}

}  // namespace portolan
