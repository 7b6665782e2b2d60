// Submaps as agents would upload them, made from a world of points without rendering any image:
// several cameras circle in a round room and look at its wall, observe points with pixel noise and
// guess their poses with drift, as a filter would. Exact ground truth comes along.
#ifndef PORTOLAN_TESTS_SUPPORT_SYNTHETIC_SUBMAPS_H_
#define PORTOLAN_TESTS_SUPPORT_SYNTHETIC_SUBMAPS_H_

#include <cstdint>
#include <map>
#include <memory>
#include <vector>

#include "common/camera/camera_model.h"
#include "common/geometry/similarity3.h"
#include "common/submap/submap.h"

namespace portolan {

struct SyntheticAgent {
  // The camera's bearing in the room, from start to end, in radians; a full circle is a loop.
  double start_rad = 0;
  double end_rad = 3;
  int submaps = 5;
  // Radius of the circle on which the camera moves; 0 turns on the spot.
  double circle_m = 1.5;
};

struct SyntheticSubmapsOptions {
  uint32_t seed = 1;
  std::vector<SyntheticAgent> agents = {SyntheticAgent{}};
  int keyframes_per_submap = 10;
  int points = 3000;
  int max_observations = 150;  // a keyframe
  double wall_min_m = 3;       // points lie between these distances from the room's axis
  double wall_max_m = 5;
  double pixel_sigma = 0.5;
  double outlier_share = 0;  // of observations, replaced by random pixels
  // Random walk of the filter's poses from keyframe to keyframe.
  double drift_rotation_rad = 0.001;
  double drift_translation_share = 0.01;  // of the step
  // The scale of every submap relative to its predecessor: exp(sigma * n).
  double scale_drift = 0.05;
  // The first submap's units in a metre; agents differ: agent i has unit * (1 + 0.3 i).
  double unit = 0.7;
  bool metric = false;                 // then all units are metres and the scale does not drift
  int flipped_bits = 8;                // noise of the descriptors
  bool identical_descriptors = false;  // every point looks like nine others
};

struct SyntheticSubmap {
  SubmapId id;
  std::shared_ptr<const Submap> submap;
  // True camera poses, parallel to the keyframes, metres.
  std::vector<Rigid3> world_from_camera;
  // True similarity, with the units the filter believes in.
  Similarity3 world_from_submap;
};

struct SyntheticMission {
  std::shared_ptr<const CameraModel> camera;
  // In the order in which a server would commit them: the agents take turns. Ids count from 1.
  std::vector<SyntheticSubmap> submaps;
  // The point that an agent's track shows; tracks are unique per agent (session).
  std::vector<std::map<TrackId, Eigen::Vector3d>> points_of_tracks;  // by agent
  std::vector<std::map<TrackId, int>> point_ids_of_tracks;           // by agent
  std::vector<int> agent_of_submap;                                  // parallel to submaps
};

SyntheticMission MakeSyntheticMission(const SyntheticSubmapsOptions& options);

// Root mean square distance of two sets of positions after the best similarity (Umeyama 1991) or,
// without scale, rigid motion.
double AlignedRms(const std::vector<Eigen::Vector3d>& estimate,
                  const std::vector<Eigen::Vector3d>& truth, bool with_scale = true);

}  // namespace portolan

#endif  // PORTOLAN_TESTS_SUPPORT_SYNTHETIC_SUBMAPS_H_
