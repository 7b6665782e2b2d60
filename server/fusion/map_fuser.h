// Last stage: the working model of the map as an immutable snapshot with fused landmarks.
#ifndef PORTOLAN_SERVER_FUSION_MAP_FUSER_H_
#define PORTOLAN_SERVER_FUSION_MAP_FUSER_H_

#include <cstdint>
#include <memory>
#include <optional>
#include <set>

#include "server/alignment/map_aligner.h"
#include "server/fusion/map_state.h"

namespace portolan {

struct MapFuserOptions {
  // A landmark is published once so many keyframes agree on it, not counting redundant ones, of
  // which the estimate knows nothing ...
  int min_observations = 3;
  // ... and its standard deviation, in share of its distance from the cameras, is under this.
  double max_relative_sigma = 0.1;
  // Movements under these are no movement: share of the component's scale (median landmark
  // distance), and radians. A tenth of a pixel.
  double moved_translation_of_depth = 2e-4;
  double moved_rotation_rad = 2e-4;

  Status Validate() const;
};

// Gives an empty aligner the state of a snapshot.
void RestoreMap(const MapSnapshot& snapshot, MapAligner* aligner);

// Thread-compatible.
class MapFuser {
 public:
  explicit MapFuser(const MapFuserOptions& options) : options_(options) {}

  // The next version: submaps that the aligner touched are new, all others shared with `previous`;
  // costs what changed, and a pointer a submap.
  // Landmark covariances are conditional on the cameras (the inverse of the point's block of the
  // adjusted system): right for a landmark seen from a known camera, too small by the cameras' own
  // uncertainty in the world.
  std::shared_ptr<const MapSnapshot> Fuse(const MapSnapshot& previous, MapAligner* aligner) const;

  // Mean, covariance and sights of one landmark of the model; no value if it is not good enough.
  std::optional<FusedLandmark> FuseLandmark(const MapModel& model, int index) const;

 private:
  std::shared_ptr<const SubmapState> FuseSubmap(const MapAligner& aligner, SubmapId id,
                                                const SubmapState* previous,
                                                uint64_t version) const;
  // The state at its new place; the landmarks' covariances turn and grow with the submap.
  std::shared_ptr<const SubmapState> MoveState(const MapAligner& aligner, SubmapId id,
                                               const SubmapState& previous, uint64_t version) const;
  // moved_at_version, by how far the cameras moved relative to the depth of the scene.
  uint64_t MovedAt(const ModelSubmap& submap, const MapModel& model, const SubmapState* previous,
                   uint64_t version) const;
  // The state with some of its landmarks anew.
  std::shared_ptr<const SubmapState> FuseSomeLandmarks(const MapModel& model, SubmapId id,
                                                       const SubmapState& previous,
                                                       const std::set<TrackId>& tracks) const;

  MapFuserOptions options_;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_FUSION_MAP_FUSER_H_
