// The thread that owns the map: integrates committed submaps, does background work when idle,
// publishes and saves each version. A second thread prepares the submaps that wait in the queue.
#ifndef PORTOLAN_SERVER_PIPELINE_MAP_THREAD_H_
#define PORTOLAN_SERVER_PIPELINE_MAP_THREAD_H_

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "common/base/time.h"
#include "server/pipeline/map_engine.h"
#include "server/pipeline/snapshot_hub.h"
#include "server/store/map_store.h"

namespace portolan {

struct MapThreadOptions {
  // Committed submaps that wait for integration; when so many wait, commits and hence
  // acknowledgements wait too, and the agents keep their submaps in their outboxes. 256 is a few
  // seconds of 100 agents and at most 0.1 GB.
  int max_queue = 256;
  // While submaps keep coming the map is saved this often; what was not saved is integrated again
  // after a crash. A save of a large solve takes a second and holds up commits.
  Duration save_interval = std::chrono::seconds(5);
  // How long a submap that is ready may wait for background work; longer by the preparation of
  // another one that has begun. Interrupted at once, background work would get nothing done between
  // the submaps of a hundred agents.
  Duration background_patience = std::chrono::milliseconds(100);
  // The map settles once no submap has come for so long, or when someone asks for that; in lockstep
  // only then.
  Duration settling_patience = std::chrono::seconds(3);
  // Background work is completed and the map saved after every single submap, so that the result
  // depends on the order of submaps only, not on time, and survives a crash to the bit.
  bool lockstep = false;

  Status Validate() const;
};

// Protocol: construct, Start, Push..., Shutdown (or destruction). Thread-safe. Owns the engine;
// store and hub must outlive it.
class MapThread {
 public:
  MapThread(const MapThreadOptions& options, std::unique_ptr<MapEngine> engine, MapStore* store,
            SnapshotHub* hub);
  ~MapThread();

  // `backlog`: submaps that are committed but not in the engine's map, ascending.
  void Start(std::vector<SubmapInput> backlog);

  // Hands over committed submaps in order of commit; blocks while the queue is full. After
  // Shutdown the submaps are dropped: they are committed and come back as backlog.
  void Push(std::vector<SubmapInput> submaps);

  // Hands over the control points, to be used from the next idle moment on.
  void SetSurvey(std::shared_ptr<const Survey> survey);

  // Calls `done`, on the map thread, once everything pushed before is integrated, no background
  // work is left, the map has settled and the result is saved. After Shutdown: never.
  void WhenSettled(std::function<void(uint64_t map_version)> done);

  // Interrupts background work, saves and ends. Submaps in the queue stay for the next start.
  void Shutdown();

  StageTimes stage_times() const;
  // Submaps pushed but not yet in a published map.
  int queue_size() const;
  // The first failed save; the map goes on in memory.
  Status save_status() const;

 private:
  struct Waiter {
    uint64_t pushed;  // settled once so many submaps and surveys are taken in
    std::function<void(uint64_t)> done;
  };

  // A submap in the queue.
  struct Entry {
    SubmapInput input;
    // By the preparing thread or, to be refined, by the map thread; the preparing thread does not
    // wait for that, and refines the submap once more if its turn comes before.
    bool is_taken = false;
    bool is_prepared = false;
    std::chrono::steady_clock::time_point prepared_at = {};
  };

  void Run();
  // Prepares what waits in the queue, in its order.
  void RunPreparations();
  std::shared_ptr<Entry> NextToPrepare() const;
  // More submaps wait than are prepared ahead.
  bool IsBehind() const;
  // If the preparing thread is behind: the last of the next submaps that nobody has begun with.
  std::shared_ptr<Entry> NextToRefine() const;
  // Interrupts background work for which the oldest submap has waited long enough, or too many
  // wait; otherwise waits for that, or for something to prepare.
  void AwaitWork(std::unique_lock<std::mutex>* lock);
  bool MustInterrupt(std::chrono::steady_clock::time_point now) const;
  // True if the map thread may integrate the oldest submap.
  bool HasPrepared() const { return !queue_.empty() && queue_.front()->is_prepared; }
  void Integrate(const SubmapInput& input);
  void FinishBackgroundWork();
  bool MaySettle() const;
  // Until there is something to do: a submap, a survey, somebody who waits for the map to settle
  // or, if it has not settled, the time for that.
  void AwaitInput(bool is_settled, std::unique_lock<std::mutex>* lock);
  // Publishes the engine's snapshot if it is new.
  void Publish();
  void Save();
  // Fires the waiters; only when idle and saved.
  void NotifySettled();

  const MapThreadOptions options_;
  const std::unique_ptr<MapEngine> engine_;
  MapStore* const store_;
  SnapshotHub* const hub_;

  // Used by the map thread only.
  std::shared_ptr<const MapSnapshot> published_;
  std::shared_ptr<const MapSnapshot> saved_;
  std::chrono::steady_clock::time_point last_save_;
  std::chrono::steady_clock::time_point last_input_;

  // Makes background work return early.
  std::atomic<bool> interrupt_ = false;
  mutable std::mutex mutex_;
  std::condition_variable wake_;
  std::condition_variable has_room_;
  std::condition_variable has_entry_;  // for the preparing thread
  // Guarded by mutex_.
  std::deque<std::shared_ptr<Entry>> queue_;
  std::shared_ptr<const Survey> survey_;  // not taken in yet; null for none
  std::vector<Waiter> waiters_;
  StageTimes stage_times_;
  Status save_status_;
  uint64_t pushed_count_ = 0;
  uint64_t integrated_count_ = 0;
  bool stop_ = false;

  std::thread thread_;
  std::thread preparing_thread_;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_PIPELINE_MAP_THREAD_H_
