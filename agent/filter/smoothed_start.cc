// The smoothed start of LocalFilter.
#include "agent/filter/known_depths.h"
#include "agent/filter/local_filter.h"

namespace portolan {

void LocalFilter::RecordStart(UpdateResult* result) {
  if (!start_.active()) return;
  std::vector<StartSmoother::Observation> observations;
  for (const Candidate& candidate : candidates_) {
    observations.push_back({candidate.track, candidate.match.pixel, candidate.match.variance});
  }
  const double noise_factor = result->manoeuvre ? options_.manoeuvre_noise_factor : 1.0;
  const bool due =
      start_.AddFrame(state_.motion(), {scene_depth_of_prediction_, noise_factor}, observations);
  const bool known = start_.at_frame() && start_.frames() >= options_.start.min_frames &&
                     start_.frames() >= retry_frames_ && DepthsAreKnown();
  if (!due && !known) return;
  if (SolveStart(result) && !DepthsAreKnown()) {
    if (!due) {
      retry_frames_ = start_.frames() + options_.start.min_frames;
      return;
    }
    retry_frames_ = 0;
    if (start_.ThinOut()) return;
  }
  start_.End();
}

bool LocalFilter::SolveStart(UpdateResult* result) {
  std::vector<TrackId> before;
  for (const Landmark& landmark : state_.landmarks()) before.push_back(landmark.track);
  if (!start_.Solve(camera_, &state_)) return false;
  restated_poses_ = start_.Poses();
  for (TrackId track : before) {
    if (!HasLandmark(track)) result->dropped.push_back(track);
  }
  return true;
}

bool LocalFilter::DepthsAreKnown() const {
  return 2 * MeanOfKnownDepths(state_, options_.start.known_depth_sigma_ratio).count >=
         landmark_count();
}

}  // namespace portolan
