// MapStore on one SQLite file (WAL, synchronous=FULL). Schema and blob layouts: README.md.
#ifndef PORTOLAN_SERVER_STORE_SQLITE_MAP_STORE_H_
#define PORTOLAN_SERVER_STORE_SQLITE_MAP_STORE_H_

#include <atomic>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "server/store/derived_tables.h"
#include "server/store/map_store.h"
#include "server/store/sqlite.h"

namespace portolan {

struct SqliteMapStoreOptions {
  // SQLite's operating system layer, empty for the default; tests inject disk faults there.
  std::string vfs;
  // Size of the write-ahead log at which it is copied into the database file, in pages of 4 KiB;
  // 16 MiB keeps the copying rare and the log small beside the map.
  int checkpoint_pages = 4096;

  Status Validate() const;
};

// Thread-safe: one lock around the connection; saves are encoded before they take it. Holds the
// file exclusively: a second store, of this or another process, is refused with Unavailable.
class SqliteMapStore : public MapStore {
 public:
  // Creates the file if there is none. NotFound, PermissionDenied, DataLoss (not a map, damaged),
  // FailedPrecondition (newer version), Unavailable (in use).
  static StatusOr<std::unique_ptr<SqliteMapStore>> Open(const std::string& path,
                                                        const SqliteMapStoreOptions& options = {});

  Status AddSession(const SessionRecord& session) override;
  Status FinishSession(const AgentId& agent, SessionId session) override;
  StatusOr<std::vector<SubmapId>> AppendSubmaps(const std::vector<NewSubmap>& submaps) override;
  Status SaveSnapshot(const MapSnapshot& snapshot) override;
  Status DropDerived() override;
  StatusOr<StoredMap> Load(const SubmapDecoder& decode) override;
  StatusOr<std::vector<SubmapId>> SubmapsInBox(ComponentId component, const Box& box) override;
  Status SaveSurvey(const Survey& survey) override;
  StatusOr<int64_t> SizeBytes() override;

 private:
  using SessionName = std::pair<AgentId, SessionId>;

  explicit SqliteMapStore(std::unique_ptr<SqliteDatabase> database)
      : database_(std::move(database)) {}

  // Runs `write` in a transaction; after a failure the store refuses writes.
  template <typename Write>
  Status WriteLocked(Write write);
  Status CheckWritable() const;
  Status LoadSessionIds();
  Status UpdateSize();
  Status InsertSession(const SessionRecord& session);
  StatusOr<SubmapId> InsertSubmap(SqliteStatement& insert, const NewSubmap& submap);
  StatusOr<std::vector<SessionRecord>> ReadSessions();
  StatusOr<std::vector<StoredSubmap>> ReadSubmaps(const std::vector<SessionRecord>& sessions,
                                                  const SubmapDecoder& decode);

  std::mutex mutex_;
  // Everything below is guarded by mutex_.
  std::unique_ptr<SqliteDatabase> database_;
  Status failure_;  // the first failed write
  struct SessionRow {
    int64_t id;
    CameraIntrinsics camera;
  };
  std::map<SessionName, SessionRow> sessions_;

  // Taken before mutex_.
  void RememberClosures(const MapSnapshot& snapshot);

  std::mutex saved_mutex_;
  // Guarded by saved_mutex_: what the derived tables hold, so that a save writes the difference.
  std::unordered_map<SubmapId, std::shared_ptr<const SubmapState>> saved_states_;
  SavedClosures saved_closures_;

  // Known without a lock, so that a large save holds up no query.
  std::atomic<int64_t> size_bytes_ = 0;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_STORE_SQLITE_MAP_STORE_H_
