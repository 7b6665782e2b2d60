#include "server/store/schema.h"

#include <array>

#include "absl/strings/str_cat.h"

namespace portolan {
namespace {

constexpr char kRawTables[] = R"sql(
CREATE TABLE session (
  id INTEGER PRIMARY KEY,
  agent TEXT NOT NULL,
  session INTEGER NOT NULL,
  width_px INTEGER NOT NULL,
  height_px INTEGER NOT NULL,
  fx_px REAL NOT NULL,
  fy_px REAL NOT NULL,
  cx_px REAL NOT NULL,
  cy_px REAL NOT NULL,
  distortion INTEGER NOT NULL,
  coefficients BLOB NOT NULL,
  finished INTEGER NOT NULL DEFAULT 0,
  UNIQUE (agent, session)
);
CREATE TABLE raw_submap (
  id INTEGER PRIMARY KEY,
  session_id INTEGER NOT NULL REFERENCES session (id),
  sequence_number INTEGER NOT NULL,
  hash INTEGER NOT NULL,
  bytes BLOB NOT NULL,
  UNIQUE (session_id, sequence_number)
);
CREATE TRIGGER raw_submap_is_never_changed BEFORE UPDATE ON raw_submap
BEGIN SELECT RAISE(ABORT, 'raw submaps are immutable'); END;
CREATE TRIGGER raw_submap_is_never_deleted BEFORE DELETE ON raw_submap
BEGIN SELECT RAISE(ABORT, 'raw submaps are immutable'); END;
)sql";

constexpr char kSurveyTables[] = R"sql(
CREATE TABLE control_point (
  id TEXT PRIMARY KEY,
  is_geodetic INTEGER NOT NULL,
  x REAL NOT NULL,
  y REAL NOT NULL,
  z REAL NOT NULL,
  sigma_m REAL NOT NULL
) WITHOUT ROWID;
CREATE TABLE control_observation (
  control_point TEXT NOT NULL REFERENCES control_point (id),
  position INTEGER NOT NULL,
  agent TEXT NOT NULL,
  session INTEGER NOT NULL,
  time_ns INTEGER NOT NULL,
  u_px REAL NOT NULL,
  v_px REAL NOT NULL,
  sigma_px REAL NOT NULL,
  PRIMARY KEY (control_point, position)
) WITHOUT ROWID;
CREATE TABLE site_origin (
  id INTEGER PRIMARY KEY CHECK (id = 1),
  latitude_deg REAL,
  longitude_deg REAL,
  height_m REAL,
  grid_x REAL NOT NULL,
  grid_y REAL NOT NULL,
  grid_z REAL NOT NULL
);
)sql";

constexpr char kDerivedTables[] = R"sql(
CREATE TABLE map_state (
  key TEXT PRIMARY KEY,
  value INTEGER NOT NULL
) WITHOUT ROWID;
CREATE TABLE component (
  id INTEGER PRIMARY KEY,
  metric INTEGER NOT NULL,
  gravity_aligned INTEGER NOT NULL,
  georeference BLOB NOT NULL
);
CREATE TABLE refined_submap (
  submap_id INTEGER PRIMARY KEY,
  rms_reprojection_px REAL NOT NULL,
  quarantine_reason TEXT NOT NULL,
  estimate BLOB NOT NULL
);
CREATE TABLE submap_state (
  submap_id INTEGER PRIMARY KEY,
  component_id INTEGER NOT NULL,
  moved_at_version INTEGER NOT NULL,
  pose BLOB NOT NULL,
  landmark_count INTEGER NOT NULL,
  landmarks BLOB NOT NULL
);
CREATE VIRTUAL TABLE landmark_bounds USING rtree (
  submap_id, min_x, max_x, min_y, max_y, min_z, max_z, +component_id INTEGER
);
CREATE TABLE closure (
  position INTEGER PRIMARY KEY,
  accepted INTEGER NOT NULL,
  submap_a INTEGER NOT NULL,
  submap_b INTEGER NOT NULL,
  estimate BLOB NOT NULL
);
)sql";

Status SetPragma(SqliteDatabase& database, const char* name, int64_t value) {
  return database.Execute(absl::StrCat("PRAGMA ", name, " = ", value));
}

Status MigrateTo1(SqliteDatabase& database) {
  PORTOLAN_RETURN_IF_ERROR(database.Execute(kRawTables));
  return SetPragma(database, "application_id", kApplicationId);
}

Status MigrateTo2(SqliteDatabase& database) { return database.Execute(kSurveyTables); }

// kMigrations[i] takes the raw tables from version i to i + 1.
using Migration = Status (*)(SqliteDatabase&);
constexpr std::array<Migration, kSchemaVersion> kMigrations = {MigrateTo1, MigrateTo2};

Status CheckOrigin(SqliteDatabase& database, int64_t version) {
  PORTOLAN_ASSIGN_OR_RETURN(const int64_t application_id,
                            database.QueryInteger("PRAGMA application_id"));
  PORTOLAN_ASSIGN_OR_RETURN(const int64_t objects,
                            database.QueryInteger("SELECT count(*) FROM sqlite_master"));
  if (application_id != kApplicationId && (objects > 0 || application_id != 0)) {
    return absl::DataLossError("an SQLite database of another program, not a Portolan map");
  }
  if (version > kSchemaVersion) {
    return absl::FailedPreconditionError(
        absl::StrCat("written by a newer Portolan (schema version ", version,
                     ", this program knows up to ", kSchemaVersion, ")"));
  }
  return absl::OkStatus();
}

}  // namespace

Status PrepareSchema(SqliteDatabase& database) {
  PORTOLAN_ASSIGN_OR_RETURN(const int64_t version, database.QueryInteger("PRAGMA user_version"));
  PORTOLAN_RETURN_IF_ERROR(CheckOrigin(database, version));
  for (int64_t v = version; v < kSchemaVersion; ++v) {
    PORTOLAN_ASSIGN_OR_RETURN(SqliteTransaction transaction, SqliteTransaction::Begin(database));
    PORTOLAN_RETURN_IF_ERROR(kMigrations[v](database));
    PORTOLAN_RETURN_IF_ERROR(SetPragma(database, "user_version", v + 1));
    PORTOLAN_RETURN_IF_ERROR(transaction.Commit());
  }
  PORTOLAN_ASSIGN_OR_RETURN(
      const int64_t derived,
      database.QueryInteger("SELECT count(*) FROM sqlite_master WHERE name = 'map_state'"));
  if (derived > 0) return absl::OkStatus();
  PORTOLAN_ASSIGN_OR_RETURN(SqliteTransaction transaction, SqliteTransaction::Begin(database));
  PORTOLAN_RETURN_IF_ERROR(CreateDerivedTables(database));
  return transaction.Commit();
}

Status DropDerivedTables(SqliteDatabase& database) {
  for (const char* table :
       {"map_state", "component", "refined_submap", "submap_state", "landmark_bounds", "closure"}) {
    PORTOLAN_RETURN_IF_ERROR(database.Execute(absl::StrCat("DROP TABLE IF EXISTS ", table)));
  }
  return absl::OkStatus();
}

Status CreateDerivedTables(SqliteDatabase& database) {
  PORTOLAN_RETURN_IF_ERROR(database.Execute(kDerivedTables));
  return database.Execute(
      absl::StrCat("INSERT INTO map_state VALUES ('derived_version', ", kDerivedVersion, ")"));
}

}  // namespace portolan
