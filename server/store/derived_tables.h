// Reading and writing of the derived tables, inside the caller's transaction and lock.
#ifndef PORTOLAN_SERVER_STORE_DERIVED_TABLES_H_
#define PORTOLAN_SERVER_STORE_DERIVED_TABLES_H_

#include <memory>
#include <string>
#include <unordered_map>
#include <vector>

#include "server/store/map_store.h"
#include "server/store/sqlite.h"

namespace portolan {

using SubmapStates = std::unordered_map<SubmapId, std::shared_ptr<const SubmapState>>;

// The rows of one changed submap, encoded before the lock is taken.
struct EncodedState {
  std::shared_ptr<const SubmapState> state;
  // Empty if the refined submap is the stored one.
  std::string refined;
  std::string pose;
  std::string landmarks;
};

struct EncodedClosure {
  bool accepted = false;
  size_t position = 0;  // in its list
  std::shared_ptr<const Closure> closure;
  std::string estimate;
};

// What the tables hold.
struct SavedClosures {
  ClosureList accepted;
  ClosureList waiting;
};

// The states of `snapshot` that differ, by identity, from those in `saved`.
std::vector<EncodedState> EncodeChangedStates(const MapSnapshot& snapshot,
                                              const SubmapStates& saved);
// The closures that differ, by identity, from the saved ones at the same position.
std::vector<EncodedClosure> EncodeChangedClosures(const MapSnapshot& snapshot,
                                                  const SavedClosures& saved);

Status WriteStates(SqliteDatabase& database, const std::vector<EncodedState>& states);
// Deletes the rows of submaps that left the map.
Status DeleteStates(SqliteDatabase& database, const std::vector<SubmapId>& submaps);
// Writes the changed closures and deletes those behind the ends of the snapshot's lists.
Status WriteClosures(SqliteDatabase& database, const std::vector<EncodedClosure>& closures,
                     const MapSnapshot& snapshot);
Status WriteComponents(SqliteDatabase& database, const MapSnapshot& snapshot);

// Null if nothing was ever saved. DataLoss if something does not fit together.
StatusOr<std::shared_ptr<const MapSnapshot>> ReadSnapshot(SqliteDatabase& database,
                                                          const std::vector<StoredSubmap>& submaps);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_STORE_DERIVED_TABLES_H_
