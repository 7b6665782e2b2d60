// Builds the global map from the agents' submaps: the whole path from an uploaded submap to a new
// version of the map, one call a stage (see IntegrateSubmap).
#ifndef PORTOLAN_SERVER_MAP_BUILDER_H_
#define PORTOLAN_SERVER_MAP_BUILDER_H_

#include <atomic>
#include <cstdint>
#include <memory>

#include "common/base/status.h"
#include "common/camera/camera_model.h"
#include "common/submap/submap.h"
#include "server/fusion/map_state.h"
#include "server/map_builder_options.h"

namespace portolan {

// One committed submap and the camera that took it.
struct SubmapInput {
  SubmapId id;
  std::shared_ptr<const Submap> submap;
  std::shared_ptr<const CameraModel> camera;
  // MapBuilder::Refine() of the above, if somebody had the time.
  std::shared_ptr<const RefinedSubmap> refined = nullptr;
};

// Wall time of one stage since the builder was created.
struct StageTime {
  int64_t count = 0;
  double last_ms = 0;
  double max_ms = 0;
  double total_ms = 0;
};

struct StageTimes {
  StageTime refine;
  StageTime link;
  StageTime recognise;
  StageTime verify;
  StageTime align;
  StageTime fuse;
  StageTime background;
};

// Thread-compatible: one thread calls it, except for Refine. Knows no thread, database or message.
// Snapshots are immutable and may be shared with other threads.
class MapBuilder {
 public:
  static StatusOr<std::unique_ptr<MapBuilder>> Create(const MapBuilderOptions& options);
  ~MapBuilder();

  // Continues a stored map; call it before the first submap is integrated. The indices are
  // rebuilt from the refined submaps.
  void Restore(std::shared_ptr<const MapSnapshot> snapshot);

  // Control points and origin of the site, instead of those before; the background work that
  // follows uses them.
  void SetSurvey(std::shared_ptr<const Survey> survey);

  // The first stage alone; thread-safe, for it depends on nothing but its argument. Put the result
  // into the input, and IntegrateSubmap need not do it.
  std::shared_ptr<const RefinedSubmap> Refine(const SubmapInput& input) const;

  // Takes one submap, which is valid (common/wire checked it), through all stages. Ids ascend; a
  // submap that is there already is ignored. A submap that cannot be refined is kept, in a
  // component of its own.
  void IntegrateSubmap(const SubmapInput& input);

  // True while the map can gain from RunBackgroundWork.
  bool HasBackgroundWork() const;

  // Polishes one component by bundle adjustment over all of its observations. Returns early once
  // `interrupt` is true and keeps what it gained.
  void RunBackgroundWork(const std::atomic<bool>& interrupt);

  // The newest version of the map; never null.
  std::shared_ptr<const MapSnapshot> snapshot() const;

  StageTimes stage_times() const;

 private:
  class Impl;
  explicit MapBuilder(std::unique_ptr<Impl> impl);

  std::unique_ptr<Impl> impl_;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_MAP_BUILDER_H_
