#include "agent/landmarks/landmark_manager.h"

#include <algorithm>

namespace portolan {

Status LandmarkManagerOptions::Validate() const {
  if (target_landmarks < 8 || target_landmarks > max_landmarks) {
    return absl::InvalidArgumentError("landmarks.target must be within 8 and landmarks.max");
  }
  if (min_age_frames < 0 || max_outlier_frames < 1 || max_missed_frames < 1) {
    return absl::InvalidArgumentError("landmarks: ages and frame limits must be positive");
  }
  if (grid_columns < 1 || grid_rows < 1 || grid_columns > 64 || grid_rows > 64) {
    return absl::InvalidArgumentError("landmarks: the grid must be within 1 and 64 cells a side");
  }
  return absl::OkStatus();
}

LandmarkManager::LandmarkManager(const LandmarkManagerOptions& options, const CameraModel& camera)
    : options_(options), camera_(camera) {}

bool LandmarkManager::WasOutlier(TrackId track) const {
  const auto it = landmarks_.find(track);
  return it != landmarks_.end() && it->second.outlier_frames > 0;
}

LandmarkRemovals LandmarkManager::Report(const std::vector<PredictedMeasurement>& predicted,
                                         const UpdateResult& update) {
  for (auto& [track, upkeep] : landmarks_) ++upkeep.unseen_frames;
  // Counted as missed first; the measured ones are set back below.
  for (const PredictedMeasurement& prediction : predicted) {
    const auto it = landmarks_.find(prediction.track);
    if (it != landmarks_.end()) ++it->second.missed_frames;
  }
  for (TrackId track : update.inliers) {
    const auto it = landmarks_.find(track);
    if (it != landmarks_.end()) it->second = Upkeep();
  }
  LandmarkRemovals removals;
  for (TrackId track : update.outliers) {
    const auto it = landmarks_.find(track);
    if (it == landmarks_.end()) continue;
    it->second.missed_frames = 0;
    if (++it->second.outlier_frames >= options_.max_outlier_frames) {
      removals.tracks.push_back(track);
      removals.landmarks.push_back(track);
    }
  }
  for (const auto& [track, upkeep] : landmarks_) {
    if (upkeep.missed_frames > options_.max_missed_frames) removals.landmarks.push_back(track);
  }
  std::sort(removals.landmarks.begin(), removals.landmarks.end());
  std::sort(removals.tracks.begin(), removals.tracks.end());
  return removals;
}

size_t LandmarkManager::CellOf(const Eigen::Vector2d& pixel) const {
  const int column = static_cast<int>(pixel.x() * options_.grid_columns / camera_.width_px());
  const int row = static_cast<int>(pixel.y() * options_.grid_rows / camera_.height_px());
  return static_cast<size_t>(std::clamp(row, 0, options_.grid_rows - 1) * options_.grid_columns +
                             std::clamp(column, 0, options_.grid_columns - 1));
}

std::vector<TrackId> LandmarkManager::Choose(const std::vector<TrackedPoint>& points, int measured,
                                             bool starting) const {
  std::vector<int> landmarks_in_cell(
      static_cast<size_t>(options_.grid_columns * options_.grid_rows));
  std::vector<const TrackedPoint*> candidates;
  for (const TrackedPoint& point : points) {
    if (IsLandmark(point.track)) {
      ++landmarks_in_cell[CellOf(point.pixel)];
    } else if (starting || point.age_frames >= options_.min_age_frames) {
      candidates.push_back(&point);
    }
  }
  // Long-lived tracks first; the id makes the order total, hence repeatable.
  std::sort(candidates.begin(), candidates.end(), [](const auto* a, const auto* b) {
    return a->age_frames != b->age_frames ? a->age_frames > b->age_frames : a->track < b->track;
  });
  std::vector<TrackId> chosen;
  std::vector<bool> taken(candidates.size());
  for (int allowed_in_cell = 1; measured < options_.target_landmarks && allowed_in_cell <= 6;
       ++allowed_in_cell) {
    for (size_t i = 0; i < candidates.size() && measured < options_.target_landmarks; ++i) {
      const size_t cell = CellOf(candidates[i]->pixel);
      if (taken[i] || landmarks_in_cell[cell] >= allowed_in_cell) continue;
      taken[i] = true;
      ++landmarks_in_cell[cell];
      ++measured;
      chosen.push_back(candidates[i]->track);
    }
  }
  std::sort(chosen.begin(), chosen.end());
  return chosen;
}

std::vector<TrackId> LandmarkManager::MakeRoomFor(int count) const {
  const int surplus = this->count() + count - options_.max_landmarks;
  std::vector<std::pair<int, TrackId>> unseen;
  for (const auto& [track, upkeep] : landmarks_) {
    if (upkeep.unseen_frames > 0) unseen.emplace_back(-upkeep.unseen_frames, track);
  }
  std::sort(unseen.begin(), unseen.end());
  std::vector<TrackId> removed;
  for (int i = 0; i < surplus && i < static_cast<int>(unseen.size()); ++i) {
    removed.push_back(unseen[static_cast<size_t>(i)].second);
  }
  return removed;
}

void LandmarkManager::Add(const std::vector<TrackId>& tracks) {
  for (TrackId track : tracks) landmarks_.emplace(track, Upkeep());
}

void LandmarkManager::Remove(const std::vector<TrackId>& tracks) {
  for (TrackId track : tracks) landmarks_.erase(track);
}

}  // namespace portolan
