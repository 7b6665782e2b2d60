// The derived state of the global map as immutable values that pass between threads. Everything
// here can be rebuilt from the raw submaps.
//
// `world` is the frame of one connected component: that of its oldest submap. Lengths are world
// units (metres once the component is metric).
#ifndef PORTOLAN_SERVER_FUSION_MAP_STATE_H_
#define PORTOLAN_SERVER_FUSION_MAP_STATE_H_

#include <cstdint>
#include <memory>
#include <vector>

#include "common/linear_algebra/symmetric3.h"
#include "server/alignment/closure_list.h"
#include "server/alignment/landmark_sight.h"
#include "server/georeference/georeference_report.h"
#include "server/refinement/refined_submap.h"
#include "server/verification/closure.h"

namespace portolan {

struct FusedLandmark {
  // LandmarkIdOf(the oldest sight); stable as long as that sight belongs to it.
  LandmarkId id;
  Eigen::Vector3d point_in_world = Eigen::Vector3d::Zero();
  Symmetric3 covariance;
  // Keyframes that observe it, over all submaps.
  int observation_count = 0;
  std::vector<LandmarkSight> sights;  // ascending
};

inline LandmarkId LandmarkIdOf(const LandmarkSight& oldest_sight) {
  return LandmarkId((oldest_sight.submap.value() << 32) | oldest_sight.track.value());
}

// What the map knows about one submap; shared, immutable, replaced as a whole when it changes.
struct SubmapState {
  std::shared_ptr<const RefinedSubmap> refined;
  ComponentId component;
  Similarity3 world_from_submap;
  // Of the right perturbation of world_from_submap, relative to the component's first submap.
  Matrix7d covariance = Matrix7d::Zero();
  // Adjusted camera poses in the world, parallel to refined->raw->keyframes.
  std::vector<Rigid3> world_from_camera;
  // refined->camera with the lens as the map has found it.
  std::shared_ptr<const CameraModel> camera;
  // The fused landmarks whose oldest sight is in this submap, ascending id.
  std::vector<FusedLandmark> landmarks;
  // Map version at which this submap last moved.
  uint64_t moved_at_version = 0;
};

// k1 and k2 of the submap's lens as the map has found it, less the calibration's.
inline Eigen::Vector2d AddedRadial(const SubmapState& state) {
  if (state.camera == nullptr || state.refined->camera == nullptr) return Eigen::Vector2d::Zero();
  const auto& now = state.camera->intrinsics().coefficients;
  const auto& nominal = state.refined->camera->intrinsics().coefficients;
  return {now[0] - nominal[0], now[1] - nominal[1]};
}

struct ComponentState {
  ComponentId id;  // value of its oldest submap's SubmapId
  bool metric = false;
  bool gravity_aligned = false;
  // Null: neither positions nor metric sensors are known in it. If georeferenced, its world is the
  // site frame, and it is metric and gravity aligned.
  std::shared_ptr<const GeoreferenceReport> georeference = nullptr;
};

// One version of the map. Submaps ascend by id; quarantined ones are included, in a component of
// their own and without landmarks.
struct MapSnapshot {
  uint64_t version = 0;
  std::vector<std::shared_ptr<const SubmapState>> submaps;
  std::vector<ComponentState> components;
  // Accepted closures only.
  std::shared_ptr<const ClosureList> closures;
  // Verified, but waiting for others that agree. A map that is continued without them loses only
  // what they might have led to.
  std::shared_ptr<const ClosureList> waiting_closures;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_FUSION_MAP_STATE_H_
