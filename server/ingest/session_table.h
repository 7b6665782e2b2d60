// What the server knows of every session besides its submaps in the map.
#ifndef PORTOLAN_SERVER_INGEST_SESSION_TABLE_H_
#define PORTOLAN_SERVER_INGEST_SESSION_TABLE_H_

#include <compare>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <unordered_map>
#include <vector>

#include "common/wire/agent_wire.h"
#include "server/store/map_store.h"

namespace portolan {

// Orders sessions by agent, then by id.
struct SessionName {
  AgentId agent;
  SessionId session;

  friend bool operator==(const SessionName&, const SessionName&) = default;
  friend auto operator<=>(const SessionName&, const SessionName&) = default;
};

struct SessionStatus {
  SessionName name;
  std::shared_ptr<const CameraModel> camera;
  bool finished = false;
  bool connected = false;
  // 1 + the highest sequence number committed or rejected.
  uint32_t next_sequence_number = 0;
  uint32_t submap_count = 0;
  // The newest one while connected.
  std::optional<LivePose> live_pose;
};

// Thread-safe.
class SessionTable {
 public:
  // Fills an empty table with what the store holds. InvalidArgument if a camera is impossible.
  Status Restore(const StoredMap& map);

  // Does nothing if the session is known.
  void Add(const SessionName& name, std::shared_ptr<const CameraModel> camera);
  std::optional<SessionStatus> Find(const SessionName& name) const;
  // By agent and, within an agent, in order of their creation.
  std::vector<SessionStatus> List() const;

  // True if the session's submap of this number is committed.
  bool IsCommitted(const SubmapKey& key) const;
  void AddCommitted(const SubmapKey& key, SubmapId id, int64_t byte_count);
  void AddRejected(const SubmapKey& key);
  void SetFinished(const SessionName& name);
  void SetConnected(const SessionName& name, bool connected);
  void SetLivePose(const SessionName& name, const LivePose& pose);

  // Size of a submap's upload; 0 if unknown.
  int64_t ByteCount(SubmapId id) const;

 private:
  struct Entry {
    SessionStatus status;
    uint64_t creation = 0;
    std::set<uint32_t> committed;
  };

  mutable std::mutex mutex_;
  // Guarded by mutex_.
  std::map<SessionName, Entry> sessions_;
  std::unordered_map<SubmapId, int64_t> byte_counts_;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_INGEST_SESSION_TABLE_H_
