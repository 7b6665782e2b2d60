// Submaps of many agents that fly through one town, as their filters would have uploaded them:
// tracks with pixel noise, poses and scales that drift, described keyframes whose descriptors
// change with the view. Made one by one, so that ten thousand need no memory.
#ifndef PORTOLAN_TESTS_SUPPORT_REPLAY_FLEET_H_
#define PORTOLAN_TESTS_SUPPORT_REPLAY_FLEET_H_

#include <memory>
#include <vector>

#include "common/submap/submap.h"
#include "tests/support/replay_world.h"

namespace portolan {

struct ReplayFleetOptions {
  ReplayWorldOptions world;
  int agents = 10;
  int keyframes_per_submap = 16;
  double keyframe_distance_m = 0.6;
  int max_tracks = 200;            // of a keyframe
  int untracked_features = 100;    // of a described keyframe
  double lost_track_share = 0.03;  // from keyframe to keyframe
  double outlier_share = 0.01;
  double pixel_sigma = 0.5;
  // Random walk of the filter's poses from keyframe to keyframe.
  double drift_rotation_rad = 0.001;
  double drift_translation_share = 0.01;  // of the step
  // The scale of every submap relative to its predecessor: exp(sigma * n).
  double scale_drift = 0.02;

  // A town in which `submaps` submaps pass every place, in each direction, `visits` times.
  static ReplayFleetOptions For(int submaps, int agents, double visits, uint64_t seed);
};

struct ReplaySubmap {
  int agent = 0;
  std::shared_ptr<const Submap> submap;
  // True camera poses, parallel to the keyframes, metres.
  std::vector<Rigid3> world_from_camera;
};

// Deterministic: submap n of an agent depends on the options only. Thread-compatible.
class ReplayFleet {
 public:
  explicit ReplayFleet(const ReplayFleetOptions& options);
  ~ReplayFleet();

  const std::shared_ptr<const CameraModel>& camera() const { return camera_; }
  // The agents take turns.
  ReplaySubmap Next();

 private:
  class Agent;

  const ReplayFleetOptions options_;
  const ReplayWorld world_;
  std::shared_ptr<const CameraModel> camera_;
  std::vector<std::unique_ptr<Agent>> agents_;
  size_t next_agent_ = 0;
};

}  // namespace portolan

#endif  // PORTOLAN_TESTS_SUPPORT_REPLAY_FLEET_H_
