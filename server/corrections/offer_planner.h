// Decides which landmarks of other agents one agent is told about, so that it can hold its live
// pose on to them.
#ifndef PORTOLAN_SERVER_CORRECTIONS_OFFER_PLANNER_H_
#define PORTOLAN_SERVER_CORRECTIONS_OFFER_PLANNER_H_

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <unordered_map>
#include <utility>
#include <vector>

#include "common/base/status.h"
#include "common/base/time.h"
#include "common/submap/landmark_offer.h"
#include "common/wire/agent_wire.h"
#include "server/fusion/map_state.h"

namespace portolan {

struct OfferOptions {
  // Long-term downlink of offers to one agent; it may ask for less. 0: nobody is offered anything.
  double bytes_per_second = 500;
  // What may be sent at once after a silence.
  double burst_bytes = 1500;
  // Landmarks of a message, and how few are worth one.
  int max_landmarks = 24;
  int min_landmarks = 8;
  // A described keyframe is a view of what the agent sees if it looks in the same direction within
  // this angle and was taken not farther away than this share of the scene's distance.
  double max_view_angle_rad = 0.7;
  double max_distance_of_depth = 0.8;
  // Of those the nearest are looked at.
  int max_views = 8;
  // Views that the agent is taken to remember. No more than it does: what is forgotten here is told
  // anew when it is wanted.
  int max_told_views = 300;
  // Landmarks that are known worse than this share of their distance are left out.
  double max_depth_sigma = 0.1;
  // A view is told again when it has moved by this share of the scene's distance, turned by as many
  // radians or changed its scale by this share.
  double moved = 2e-3;

  Status Validate() const;
};

// Of every submap that was asked for: the median depth of its landmarks, in its units. Shared by
// the planners of a map, which all look at most of its submaps again and again. Thread-compatible.
class SubmapDepths {
 public:
  double Of(const RefinedSubmap& refined);

 private:
  std::unordered_map<SubmapId, double> depths_;
};

// Remembers what the agent was told. Of the landmarks in the agent's view those that it has not
// been told of and that no submap of its own sees are offered, the best known ones in each part of
// the image first. Thread-compatible. `now` is a monotonic clock's time.
class OfferPlanner {
 public:
  // States of the agent's session in ascending sequence number.
  using States = std::vector<std::shared_ptr<const SubmapState>>;

  // depths must outlive the planner.
  OfferPlanner(const OfferOptions& options, double wanted_bytes_per_second, SubmapDepths* depths);

  // What to send now. The caller must send it.
  std::vector<LandmarkOffer> Next(const States& own, const MapSnapshot& snapshot,
                                  const std::optional<LivePose>& live_pose, Duration now);

 private:
  // A described keyframe of another session.
  struct View {
    std::shared_ptr<const SubmapState> state;
    int keyframe = 0;
    double depth = 0;     // of the scene, world units
    double distance = 0;  // from what the agent sees; small is near
    uint64_t id() const;
    Similarity3 world_from_camera() const;
  };
  struct Told {
    ComponentId component;
    Similarity3 world_from_camera;
    std::vector<LandmarkId> landmarks;
    uint64_t last = 0;  // Take's count
  };
  // Of one call.
  struct Agent {
    const SubmapState* newest = nullptr;
    Rigid3 world_from_camera;
    const CameraModel* camera = nullptr;
    std::set<SubmapId> submaps;
  };
  struct Candidate {
    const FusedLandmark* landmark = nullptr;
    OfferedLandmark offered;
    std::pair<int, int> cell;
    int rank = 0;  // in its cell
  };

  void RefillBudget(Duration now);
  // Nearest first.
  std::vector<View> FindViews(const Agent& agent, const MapSnapshot& snapshot) const;
  bool HasMoved(const View& view, const Told& told) const;
  std::vector<Candidate> FindLandmarks(const Agent& agent, const View& view) const;
  void ForgetOldestView();
  LandmarkOffer Take(const View& view, const std::vector<Candidate>& candidates);

  const OfferOptions options_;
  const double bytes_per_second_;
  SubmapDepths* const depths_;
  double budget_bytes_;
  std::optional<Duration> last_refill_;
  uint64_t takes_ = 0;
  std::map<uint64_t, Told> told_;  // by view
  std::set<LandmarkId> told_landmarks_;
};

// Where the agent's camera is in the world of its newest submap; `own` is not empty.
Rigid3 PredictCamera(const OfferPlanner::States& own, const std::optional<LivePose>& live_pose);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_CORRECTIONS_OFFER_PLANNER_H_
