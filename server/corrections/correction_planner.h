// Decides which submaps of one session its agent is told about, and when.
#ifndef PORTOLAN_SERVER_CORRECTIONS_CORRECTION_PLANNER_H_
#define PORTOLAN_SERVER_CORRECTIONS_CORRECTION_PLANNER_H_

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <vector>

#include "common/base/status.h"
#include "common/base/time.h"
#include "common/submap/map_correction.h"
#include "server/fusion/map_state.h"

namespace portolan {

struct CorrectionOptions {
  // A submap is told again when one of its keyframes moved by more than this share of the median
  // distance of its landmarks: 1e-3 is 2 mm in a room, well under the error of the map.
  double translation_share = 1e-3;
  // ... or turned by more than this (rad): 1e-3 is 0.5 px at a focal length of 500 px.
  double rotation_rad = 1e-3;
  // ... or changed its scale by more than this share.
  double scale_share = 1e-3;
  // Long-term downlink of one agent, bytes per second. The target is 2 kB/s with the newest
  // submaps, which do not wait, acknowledgements and gRPC's framing.
  double bytes_per_second = 1500;
  // What may be sent at once after a silence, bytes: some 18 submaps.
  double burst_bytes = 6000;

  Status Validate() const;
};

// Remembers what the agent was told. The newest submap is told at once; the others wait while the
// budget is used up, and are then told as they are at that time. Thread-compatible. `now` is a
// monotonic clock's time.
class CorrectionPlanner {
 public:
  // States of one session in ascending sequence number.
  using States = std::vector<std::shared_ptr<const SubmapState>>;

  explicit CorrectionPlanner(const CorrectionOptions& options);

  // The agent (re)connects and holds the corrections up to this version completely.
  void Resume(uint64_t received_map_version, const States& states, uint64_t map_version);

  // The correction to send now, if any. `all`: everything that differs from what was told, however
  // little, whatever the budget. The caller must send what is returned.
  std::optional<MapCorrection> Next(const States& states, const MapSnapshot& snapshot, Duration now,
                                    bool all);

  // True if the last Next left submaps for later because the budget was used up.
  bool has_deferred() const { return has_deferred_; }

 private:
  struct Told {
    std::shared_ptr<const SubmapState> state;
    uint64_t map_version = 0;
    // A later state that was found to differ too little.
    std::shared_ptr<const SubmapState> unchanged = nullptr;
    // Of its landmarks, in submap units; 0 until it is needed.
    double median_depth = 0;
  };

  // True if the state is new or differs enough from what was told.
  bool MustTell(const std::shared_ptr<const SubmapState>& state, bool all);
  void RefillBudget(Duration now);

  const CorrectionOptions options_;
  // By sequence number.
  std::map<uint32_t, Told> told_;
  double budget_bytes_;
  std::optional<Duration> last_refill_;
  bool has_deferred_ = false;
};

// Size of a placement on the wire, within some ten bytes (to an agent of the present protocol).
double EstimateBytes(const SubmapPlacement& placement);

SubmapPlacement MakePlacement(const SubmapState& state, const MapSnapshot& snapshot);

// How far `state` differs from `told`, as multiples of the options' thresholds; above 1 is told.
// median_depth is that of its landmarks.
double RelativeMovement(const SubmapState& told, const SubmapState& state, double median_depth,
                        const CorrectionOptions& options);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_CORRECTIONS_CORRECTION_PLANNER_H_
