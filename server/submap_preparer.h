// The first half of a submap's way into the map: what depends on the submaps alone, not on how the
// map lies. So it can run ahead of the second half, which MapBuilder is.
#ifndef PORTOLAN_SERVER_SUBMAP_PREPARER_H_
#define PORTOLAN_SERVER_SUBMAP_PREPARER_H_

#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <unordered_map>
#include <utility>
#include <vector>

#include "common/base/status.h"
#include "common/camera/camera_model.h"
#include "common/submap/submap.h"
#include "server/fusion/map_state.h"
#include "server/map_builder_options.h"
#include "server/stage_time.h"
#include "server/verification/closure.h"

namespace portolan {

// A submap that is ready to be aligned.
struct PreparedSubmap {
  std::shared_ptr<const RefinedSubmap> refined;
  // With earlier submaps, verified.
  std::vector<Closure> closures;
};

// One committed submap and the camera that took it.
struct SubmapInput {
  SubmapId id;
  std::shared_ptr<const Submap> submap;
  std::shared_ptr<const CameraModel> camera;
  // Of an earlier run, if there was one; else it is made.
  std::shared_ptr<const RefinedSubmap> refined = nullptr;
  // What MapBuilder::Prepare() made of the above, if it was called.
  std::shared_ptr<const PreparedSubmap> prepared = nullptr;
};

// Refines, thins, recognises and verifies submaps one after another. Each is compared with those
// before it, whether or not the map has them yet, so that the result depends on their order only.
// One thread at a time calls it, except for Refine() and times().
class SubmapPreparer {
 public:
  static StatusOr<std::unique_ptr<SubmapPreparer>> Create(const MapBuilderOptions& options);

  // Submaps of a stored map, before the first is prepared.
  void Restore(const MapSnapshot& snapshot);

  // The input's refined submap, which may be put into it before it is prepared. Thread-safe.
  std::shared_ptr<const RefinedSubmap> Refine(const SubmapInput& input) const;

  // Ids ascend; a submap that is there already has no closures.
  std::shared_ptr<const PreparedSubmap> Prepare(const SubmapInput& input);

  // Of refinement, recognition and verification. Thread-safe.
  StageTimes times() const;

 private:
  SubmapPreparer(const MapBuilderOptions& options, SubmapRefiner refiner, RedundancyRemover remover,
                 std::unique_ptr<PlaceIndex> places, Verifier verifier);

  // Where a submap stands in its agent's way.
  struct Place {
    int session = 0;
    int64_t sequence_number = 0;
  };

  std::vector<PlaceCandidate> Recognise(const RefinedSubmap& refined);
  std::vector<Closure> Verify(const RefinedSubmap& refined,
                              const std::vector<PlaceCandidate>& candidates) const;
  Place PlaceOf(const Submap& raw);
  void AddPlace(const RefinedSubmap& refined);
  bool IsCandidate(const Place& here, const Place& there) const;
  void AddTime(StageTime StageTimes::* stage, double ms) const;

  const MapBuilderOptions options_;
  const SubmapRefiner refiner_;
  const RedundancyRemover remover_;
  const std::unique_ptr<PlaceIndex> places_;
  const Verifier verifier_;
  std::unordered_map<SubmapId, std::shared_ptr<const RefinedSubmap>> refined_;
  std::map<std::pair<AgentId, SessionId>, int> sessions_;
  // Of every submap in the place index.
  std::unordered_map<SubmapId, Place> place_of_;
  mutable std::mutex times_mutex_;
  mutable StageTimes times_;  // guarded by times_mutex_
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_SUBMAP_PREPARER_H_
