// The tables of a map file and their versions. See README.md for every column.
#ifndef PORTOLAN_SERVER_STORE_SCHEMA_H_
#define PORTOLAN_SERVER_STORE_SCHEMA_H_

#include <cstdint>

#include "server/store/sqlite.h"

namespace portolan {

// "PRTL"; marks an SQLite file as a Portolan map.
inline constexpr int64_t kApplicationId = 0x5052544c;
// Version of the raw tables, in user_version. Raise it with a migration.
inline constexpr int64_t kSchemaVersion = 2;
// Version of the derived tables and their blobs. Raise it on any change; older derived data are
// dropped and rebuilt, so they need no migration.
inline constexpr int64_t kDerivedVersion = 5;

// Creates the tables of an empty file, migrates an older one. FailedPrecondition for a newer file,
// DataLoss for a file that is not a map.
Status PrepareSchema(SqliteDatabase& database);

// Inside the caller's transaction.
Status DropDerivedTables(SqliteDatabase& database);
Status CreateDerivedTables(SqliteDatabase& database);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_STORE_SCHEMA_H_
