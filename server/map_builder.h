// Builds the global map from the agents' submaps: the whole path from an uploaded submap to a new
// version of the map, one call a stage (see IntegrateSubmap).
#ifndef PORTOLAN_SERVER_MAP_BUILDER_H_
#define PORTOLAN_SERVER_MAP_BUILDER_H_

#include <atomic>
#include <memory>

#include "common/base/status.h"
#include "server/fusion/map_state.h"
#include "server/map_builder_options.h"
#include "server/stage_time.h"
#include "server/submap_preparer.h"

namespace portolan {

// Thread-compatible: one thread calls it, but for Prepare, for which there may be another, and
// Refine, which any thread may call. Knows no
// thread, database or message. Snapshots are immutable and may be shared with other threads.
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

  // The first half of the way: refinement, recognition and verification, which do not ask how the
  // map lies. Put the result into the input, and IntegrateSubmap need not do it. One thread may
  // call this while another one integrates; it sees each submap in the order of their integration.
  std::shared_ptr<const PreparedSubmap> Prepare(const SubmapInput& input);

  // The first half of that half, for submaps whose turn has not come.
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

  // True if some component was adjusted since it settled. For when there is no background work, and
  // none to be expected.
  bool HasUnsettled() const;

  // Adjusts one such component so that the map no longer depends on how it came about. Interrupted
  // as background work is; there may be more of that afterwards.
  void Settle(const std::atomic<bool>& interrupt);

  // Both until nothing is left to do.
  void SettleCompletely();

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
