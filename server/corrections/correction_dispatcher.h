// Sends each connected agent the corrections of its session as the map changes.
#ifndef PORTOLAN_SERVER_CORRECTIONS_CORRECTION_DISPATCHER_H_
#define PORTOLAN_SERVER_CORRECTIONS_CORRECTION_DISPATCHER_H_

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <thread>
#include <utility>
#include <vector>

#include "server/corrections/correction_planner.h"
#include "server/corrections/offer_planner.h"
#include "server/pipeline/snapshot_hub.h"

namespace portolan {

// Where an agent's corrections go. Thread-safe.
class CorrectionSink {
 public:
  virtual ~CorrectionSink() = default;
  // False while earlier corrections are still on their way; nothing is sent then, so that a slow
  // agent gets the newest state and not a queue of old ones.
  virtual bool IsReady() const = 0;
  virtual void Send(const MapCorrection& correction) = 0;
  // Where the agent said that it is.
  virtual std::optional<LivePose> NewestPose() const { return std::nullopt; }
};

// One thread serves all agents. Thread-safe. The hub must outlive it.
class CorrectionDispatcher {
 public:
  using Key = std::pair<AgentId, SessionId>;

  CorrectionDispatcher(const CorrectionOptions& options, const OfferOptions& offers,
                       SnapshotHub* hub);
  ~CorrectionDispatcher();

  void Start();
  // Corrections of the session go to `sink` from now on, as long as it lives; a later call for
  // the same session replaces it. offered_bytes_per_second: what the agent wants of landmarks of
  // others; it holds none of them now.
  void Connect(const Key& session, uint64_t received_map_version,
               std::weak_ptr<CorrectionSink> sink, double offered_bytes_per_second = 0);
  // Looks again, because a sink became ready.
  void Wake();
  // Sends everything outstanding of the session whatever the budget, then calls `done` on the
  // dispatcher's thread with the version that the agent now knows completely.
  void Flush(const Key& session, std::function<void(uint64_t map_version)> done);
  void Shutdown();

 private:
  struct Session {
    std::unique_ptr<CorrectionPlanner> planner;
    std::unique_ptr<OfferPlanner> offers;  // null if the agent wants none, or is gone
    Duration next_offers{};
    bool offers_due(Duration now) const { return offers != nullptr && now >= next_offers; }
    std::weak_ptr<CorrectionSink> sink;
    bool resumes = false;
    // Something changed since its agent was last told all.
    bool is_dirty = true;
    uint64_t received_map_version = 0;
    std::vector<std::function<void(uint64_t)>> flushes;
  };
  // Where a submap stands among the states of its session; no session: in no agent's world.
  struct Place {
    CorrectionPlanner::States* states = nullptr;
    size_t position = 0;
    const Key* session = nullptr;
  };

  // What one round sends, once the lock is released.
  struct Delivery {
    std::shared_ptr<CorrectionSink> sink;
    std::optional<MapCorrection> correction;
    std::vector<std::function<void(uint64_t)>> flushes;
  };

  void Run();
  // One round over all sessions; true if some wait for their budget or for offers.
  bool ServeAll();
  // Brings states_ to this version; returns the sessions that changed. What did not change costs
  // the comparison of a pointer.
  std::set<Key> Follow(std::shared_ptr<const MapSnapshot> snapshot);
  Delivery Plan(Session* session, const CorrectionPlanner::States& states,
                const MapSnapshot& snapshot, Duration now);

  const CorrectionOptions options_;
  const OfferOptions offer_options_;
  SnapshotHub* const hub_;
  uint64_t subscription_ = 0;

  // Shared with the hub's callback, which may run once more after Unsubscribe.
  struct Signal {
    std::mutex mutex;
    std::condition_variable wake;
    bool raised = false;
    bool stop = false;
  };
  const std::shared_ptr<Signal> signal_ = std::make_shared<Signal>();

  // Used by the thread only: the version that states_ shows, and for each of its submaps the place.
  std::shared_ptr<const MapSnapshot> followed_;
  std::map<Key, CorrectionPlanner::States> states_;
  std::vector<Place> places_;

  std::mutex mutex_;
  SubmapDepths depths_;              // guarded by mutex_; of the sessions' planners
  std::map<Key, Session> sessions_;  // guarded by mutex_

  std::thread thread_;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_CORRECTIONS_CORRECTION_DISPATCHER_H_
