// Takes submaps from the agents: validates, drops duplicates, commits, acknowledges, and hands
// them to the map.
#ifndef PORTOLAN_SERVER_INGEST_INGEST_H_
#define PORTOLAN_SERVER_INGEST_INGEST_H_

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "common/base/status.h"
#include "common/wire/agent_wire.h"
#include "server/ingest/lockstep_schedule.h"
#include "server/ingest/session_table.h"
#include "server/map_builder.h"
#include "server/store/map_store.h"

namespace portolan {

struct IngestOptions {
  // Submaps in one commit. One sync of the disk (some 4 ms) then serves many agents; 64 submaps
  // of 40 kB are 2.5 MB.
  int max_group = 64;
  // Not empty: lockstep. Only these agents may connect, and their submaps are committed (hence
  // integrated, hence numbered) in the order of LockstepSchedule.
  std::vector<AgentId> lockstep_agents;

  Status Validate() const;
};

// What became of an upload: accepted (committed now or earlier), or rejected for a reason.
struct IngestVerdict {
  bool accepted = false;
  std::string reason;
};

// Thread-safe; one thread of its own commits. Store and table must outlive it.
//
// Backpressure: a stream submits its next submap after the verdict on the last; a verdict waits
// for the commit; a commit waits while the map's queue is full (`sink` blocks). What waits further
// stays in the agents' outboxes. Nothing is ever dropped.
class Ingest {
 public:
  // Takes committed submaps in order of commit; may block.
  using Sink = std::function<void(std::vector<SubmapInput>)>;
  // Not OK: Unavailable; the store takes no writes or the server stops. Called on any thread.
  using VerdictCallback = std::function<void(StatusOr<IngestVerdict>)>;

  // Called, on any thread, when the store failed; it then takes nothing more.
  using FailureCallback = std::function<void(const Status&)>;

  Ingest(const IngestOptions& options, MapStore* store, SessionTable* sessions, Sink sink,
         FailureCallback on_store_failure = nullptr);
  ~Ingest();

  void Start();

  // Makes the session known and durable. Returns its next sequence number. InvalidArgument for an
  // impossible camera, FailedPrecondition if it contradicts the known session or lockstep.
  StatusOr<uint32_t> OpenSession(const SessionHello& hello);

  // Judges and commits one upload of the session. One at a time waits: a later one answers it with
  // Unavailable.
  void Submit(const SessionName& session, const v1::SubmapUpload& upload, VerdictCallback done);

  // No submaps of the session follow. Calls `done` once the map may settle: at once, or in
  // lockstep when every declared agent has finished.
  void FinishSession(const SessionName& session, std::function<void(Status)> done);

  // Answers everything that still waits with Unavailable.
  void Shutdown();

 private:
  struct Pending {
    SubmapKey key;
    std::string bytes;
    std::shared_ptr<const Submap> submap;
    std::shared_ptr<const CameraModel> camera;
    VerdictCallback done;
  };

  void RestoreSchedule();
  // Everything of an upload that can be judged without the store.
  StatusOr<Pending> Judge(const SessionName& session, const v1::SubmapUpload& upload) const;
  void Run();
  // Those at the head of the line, or in lockstep the one whose turn it is; empty: wait.
  std::vector<Pending> TakeGroup();
  void Commit(std::vector<Pending> group);
  // Answers what is there already or can never come; returns what is left to commit.
  std::vector<Pending> AnswerDuplicates(std::vector<Pending> group);

  const IngestOptions options_;
  MapStore* const store_;
  SessionTable* const sessions_;
  const Sink sink_;
  const FailureCallback on_store_failure_;

  std::mutex mutex_;
  std::condition_variable wake_;
  // Guarded by mutex_.
  LockstepSchedule schedule_;
  std::deque<Pending> pending_;
  std::vector<std::function<void(Status)>> finish_waiters_;
  bool stop_ = false;

  std::thread thread_;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_INGEST_INGEST_H_
