// Decides which tracks are landmarks of the filter, and when they stop being it.
#ifndef PORTOLAN_AGENT_LANDMARKS_LANDMARK_MANAGER_H_
#define PORTOLAN_AGENT_LANDMARKS_LANDMARK_MANAGER_H_

#include <unordered_map>
#include <vector>

#include "agent/filter/local_filter.h"
#include "agent/tracker/tracker.h"
#include "common/base/status.h"
#include "common/camera/camera_model.h"

namespace portolan {

struct LandmarkManagerOptions {
  // Landmarks that the filter keeps measured in every frame; the other tracks are observations
  // for the server only.
  int target_landmarks = 50;
  // Landmarks in the filter's state, in view or not.
  int max_landmarks = 60;
  // A track must have lived this many frames before it may become a landmark, except right after
  // a start: most false corners die young.
  int min_age_frames = 3;
  // Successive frames in which a landmark may be an outlier before it and its track are dropped.
  int max_outlier_frames = 2;
  // Successive frames in which a landmark may be predicted in view and not be found.
  int max_missed_frames = 15;
  // The image is divided into this many columns and rows to spread the landmarks.
  int grid_columns = 8;
  int grid_rows = 6;

  Status Validate() const;
};

// What the owner has to drop: landmarks from the filter, and tracks from the tracker.
struct LandmarkRemovals {
  std::vector<TrackId> landmarks;
  std::vector<TrackId> tracks;
};

// Thread-compatible.
class LandmarkManager {
 public:
  LandmarkManager(const LandmarkManagerOptions& options, const CameraModel& camera);

  void Reset() { landmarks_.clear(); }

  bool IsLandmark(TrackId track) const { return landmarks_.contains(track); }
  int count() const { return static_cast<int>(landmarks_.size()); }
  // True if the filter called this track an outlier in the last frame.
  bool WasOutlier(TrackId track) const;

  // Books a frame: which landmarks were predicted in view, and what the filter said of the
  // measured ones. Returns what has failed too often.
  LandmarkRemovals Report(const std::vector<PredictedMeasurement>& predicted,
                          const UpdateResult& update);

  // Tracks that should become landmarks now, spread over the cells with the fewest landmarks.
  // measured: landmarks measured in this frame. starting: young tracks may be taken.
  std::vector<TrackId> Choose(const std::vector<TrackedPoint>& points, int measured,
                              bool starting) const;

  // Landmarks out of view that must go to make room for `count` new ones, longest unseen first.
  std::vector<TrackId> MakeRoomFor(int count) const;

  void Add(const std::vector<TrackId>& tracks);
  void Remove(const std::vector<TrackId>& tracks);

 private:
  struct Upkeep {
    int outlier_frames = 0;
    int missed_frames = 0;
    int unseen_frames = 0;
  };

  size_t CellOf(const Eigen::Vector2d& pixel) const;

  LandmarkManagerOptions options_;
  CameraModel camera_;
  std::unordered_map<TrackId, Upkeep> landmarks_;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_LANDMARKS_LANDMARK_MANAGER_H_
