// Keeps the uplink within a stated rate by leaving out the shortest tracks, those of landmarks
// counting as a little longer, and the least valuable described points. What links a submap to the
// one before is not preferred.
#ifndef PORTOLAN_AGENT_SUBMAP_SUBMAP_BUDGET_H_
#define PORTOLAN_AGENT_SUBMAP_SUBMAP_BUDGET_H_

#include <optional>

#include "common/base/status.h"
#include "common/base/time.h"
#include "common/submap/submap.h"

namespace portolan {

struct SubmapBudgetOptions {
  // Submaps' bytes per second of the sensors' time; 0: no limit. With live poses and framing the
  // uplink stays at 20 kB/s.
  double bytes_per_second = 18'000;
  // What may be sent beyond that after a quiet time, bytes: two submaps.
  double burst_bytes = 50'000;
  // Observations of a keyframe that are not left out.
  int min_observations = 200;
  // Described points that are not left out, but those of tracks that are: places must be
  // recognised.
  int min_features = 200;

  Status Validate() const;
};

// Bytes of the encoded submap, to within a tenth.
double EstimateSubmapBytes(const Submap& submap);

// One for all submaps of a session, in their order. Thread-compatible.
class SubmapBudget {
 public:
  explicit SubmapBudget(const SubmapBudgetOptions& options)
      : options_(options), bytes_(options.burst_bytes) {}

  // Leaves out the shortest tracks, down to min_observations a keyframe, then described points
  // until the submap fits what is left: first corners on no track, the weakest first, then points
  // of the tracks with the fewest sights. Returns how many described points, those of the tracks
  // included.
  int Fit(Submap* submap);

 private:
  void LeaveOutTracks(double excess_bytes, Submap* submap) const;

  const SubmapBudgetOptions options_;
  double bytes_;
  std::optional<Timestamp> last_time_;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_SUBMAP_SUBMAP_BUDGET_H_
