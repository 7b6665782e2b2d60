#include "server/store/sqlite_map_store.h"

#include <unordered_set>

#include "absl/strings/str_cat.h"
#include "server/store/blob.h"
#include "server/store/derived_tables.h"
#include "server/store/schema.h"
#include "server/store/survey_tables.h"

namespace portolan {
namespace {

// SQLite integers are signed; ids and hashes keep their bit pattern.
int64_t AsSigned(uint64_t value) { return static_cast<int64_t>(value); }
uint64_t AsUnsigned(int64_t value) { return static_cast<uint64_t>(value); }

// Commits wait for the disk; the file belongs to this process alone; pages below 4 KiB of the log
// stay until a checkpoint.
Status Configure(SqliteDatabase& database, const SqliteMapStoreOptions& options) {
  return database.Execute(absl::StrCat(
      "PRAGMA locking_mode = EXCLUSIVE; PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL; "
      "PRAGMA foreign_keys = ON; PRAGMA wal_autocheckpoint = ",
      options.checkpoint_pages));
}

Status WithPath(const Status& status, const std::string& path) {
  if (status.ok()) return status;
  std::string message = absl::StrCat("map file ", path, ": ", std::string(status.message()));
  if (absl::IsUnavailable(status)) {
    message = absl::StrCat("map file ", path, " is in use by another server (",
                           std::string(status.message()), ")");
  }
  return Status(status.code(), message);
}

SessionRecord ReadSession(const SqliteStatement& row) {
  SessionRecord session;
  session.agent = AgentId(std::string(row.ColumnBytes(1)));
  session.session = SessionId(AsUnsigned(row.ColumnInteger(2)));
  CameraIntrinsics& camera = session.camera;
  camera.width_px = static_cast<int>(row.ColumnInteger(3));
  camera.height_px = static_cast<int>(row.ColumnInteger(4));
  camera.fx_px = row.ColumnReal(5);
  camera.fy_px = row.ColumnReal(6);
  camera.cx_px = row.ColumnReal(7);
  camera.cy_px = row.ColumnReal(8);
  camera.distortion = static_cast<DistortionModel>(row.ColumnInteger(9));
  BlobReader reader(row.ColumnBytes(10));
  for (double& coefficient : camera.coefficients) coefficient = reader.Read<double>();
  session.finished = row.ColumnInteger(11) != 0;
  return session;
}

std::vector<SubmapId> LeftOver(const SubmapStates& saved, const MapSnapshot& snapshot) {
  std::unordered_set<SubmapId> present;
  for (const auto& state : snapshot.submaps) present.insert(state->refined->id);
  std::vector<SubmapId> left_over;
  for (const auto& [id, state] : saved) {
    if (!present.contains(id)) left_over.push_back(id);
  }
  return left_over;
}

}  // namespace

Status SqliteMapStoreOptions::Validate() const {
  if (checkpoint_pages < 1) return absl::InvalidArgumentError("checkpoint_pages must be positive");
  return absl::OkStatus();
}

StatusOr<std::unique_ptr<SqliteMapStore>> SqliteMapStore::Open(
    const std::string& path, const SqliteMapStoreOptions& options) {
  PORTOLAN_RETURN_IF_ERROR(options.Validate());
  StatusOr<std::unique_ptr<SqliteDatabase>> database = SqliteDatabase::Open(path, options.vfs);
  if (!database.ok()) return WithPath(database.status(), path);
  PORTOLAN_RETURN_IF_ERROR(WithPath(Configure(**database, options), path));
  PORTOLAN_RETURN_IF_ERROR(WithPath(PrepareSchema(**database), path));
  std::unique_ptr<SqliteMapStore> store(new SqliteMapStore(*std::move(database)));
  PORTOLAN_RETURN_IF_ERROR(WithPath(store->LoadSessionIds(), path));
  PORTOLAN_RETURN_IF_ERROR(WithPath(store->UpdateSize(), path));
  return store;
}

Status SqliteMapStore::CheckWritable() const {
  if (failure_.ok()) return absl::OkStatus();
  return absl::FailedPreconditionError(
      absl::StrCat("the map store takes no writes after a failed one (", failure_.ToString(), ")"));
}

template <typename Write>
Status SqliteMapStore::WriteLocked(Write write) {
  PORTOLAN_RETURN_IF_ERROR(CheckWritable());
  const auto run = [&]() -> Status {
    PORTOLAN_ASSIGN_OR_RETURN(SqliteTransaction transaction, SqliteTransaction::Begin(*database_));
    PORTOLAN_RETURN_IF_ERROR(write());
    PORTOLAN_RETURN_IF_ERROR(transaction.Commit());
    return UpdateSize();
  };
  failure_ = run();
  return failure_;
}

Status SqliteMapStore::UpdateSize() {
  PORTOLAN_ASSIGN_OR_RETURN(const int64_t pages, database_->QueryInteger("PRAGMA page_count"));
  PORTOLAN_ASSIGN_OR_RETURN(const int64_t page_size, database_->QueryInteger("PRAGMA page_size"));
  size_bytes_ = pages * page_size;
  return absl::OkStatus();
}

Status SqliteMapStore::LoadSessionIds() {
  PORTOLAN_ASSIGN_OR_RETURN(SqliteStatement rows,
                            SqliteStatement::Prepare(*database_, "SELECT * FROM session"));
  while (true) {
    PORTOLAN_ASSIGN_OR_RETURN(const bool has_row, rows.Step());
    if (!has_row) return absl::OkStatus();
    const SessionRecord session = ReadSession(rows);
    sessions_[{session.agent, session.session}] = {rows.ColumnInteger(0), session.camera};
  }
}

Status SqliteMapStore::InsertSession(const SessionRecord& session) {
  PORTOLAN_ASSIGN_OR_RETURN(SqliteStatement insert,
                            SqliteStatement::Prepare(*database_,
                                                     "INSERT INTO session VALUES "
                                                     "(NULL, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)"));
  const CameraIntrinsics& camera = session.camera;
  BlobWriter coefficients;
  for (const double coefficient : camera.coefficients) coefficients.Write(coefficient);
  insert.BindText(1, session.agent.value());
  insert.BindInteger(2, AsSigned(session.session.value()));
  insert.BindInteger(3, camera.width_px);
  insert.BindInteger(4, camera.height_px);
  insert.BindReal(5, camera.fx_px);
  insert.BindReal(6, camera.fy_px);
  insert.BindReal(7, camera.cx_px);
  insert.BindReal(8, camera.cy_px);
  insert.BindInteger(9, static_cast<int64_t>(camera.distortion));
  insert.BindBlob(10, coefficients.bytes());
  insert.BindInteger(11, session.finished);
  return insert.Run();
}

Status SqliteMapStore::AddSession(const SessionRecord& session) {
  const std::lock_guard lock(mutex_);
  const SessionName name{session.agent, session.session};
  if (const auto known = sessions_.find(name); known != sessions_.end()) {
    if (known->second.camera == session.camera) return absl::OkStatus();
    return absl::FailedPreconditionError(absl::StrCat("session ", session.session.value(),
                                                      " of agent ", session.agent.value(),
                                                      " is known with another camera calibration"));
  }
  PORTOLAN_RETURN_IF_ERROR(WriteLocked([&] { return InsertSession(session); }));
  sessions_[name] = {sqlite3_last_insert_rowid(database_->handle()), session.camera};
  return absl::OkStatus();
}

Status SqliteMapStore::FinishSession(const AgentId& agent, SessionId session) {
  const std::lock_guard lock(mutex_);
  const auto known = sessions_.find({agent, session});
  if (known == sessions_.end()) return absl::NotFoundError("unknown session");
  return WriteLocked([&] {
    return database_->Execute(
        absl::StrCat("UPDATE session SET finished = 1 WHERE id = ", known->second.id));
  });
}

StatusOr<SubmapId> SqliteMapStore::InsertSubmap(SqliteStatement& insert, const NewSubmap& submap) {
  insert.BindInteger(1, sessions_.at({submap.key.agent, submap.key.session}).id);
  insert.BindInteger(2, submap.key.sequence_number);
  insert.BindInteger(3, AsSigned(HashBytes(submap.bytes)));
  insert.BindBlob(4, submap.bytes);
  PORTOLAN_RETURN_IF_ERROR(insert.Run());
  return SubmapId(sqlite3_last_insert_rowid(database_->handle()));
}

StatusOr<std::vector<SubmapId>> SqliteMapStore::AppendSubmaps(
    const std::vector<NewSubmap>& submaps) {
  const std::lock_guard lock(mutex_);
  PORTOLAN_ASSIGN_OR_RETURN(
      SqliteStatement find,
      SqliteStatement::Prepare(
          *database_, "SELECT id FROM raw_submap WHERE session_id = ? AND sequence_number = ?"));
  for (const NewSubmap& submap : submaps) {
    const auto session = sessions_.find({submap.key.agent, submap.key.session});
    if (session == sessions_.end()) return absl::NotFoundError("unknown session");
    find.BindInteger(1, session->second.id);
    find.BindInteger(2, submap.key.sequence_number);
    PORTOLAN_ASSIGN_OR_RETURN(const bool is_known, find.Step());
    if (is_known) return absl::AlreadyExistsError("the submap is stored already");
  }
  std::vector<SubmapId> ids;
  PORTOLAN_RETURN_IF_ERROR(WriteLocked([&]() -> Status {
    PORTOLAN_ASSIGN_OR_RETURN(
        SqliteStatement insert,
        SqliteStatement::Prepare(*database_, "INSERT INTO raw_submap VALUES (NULL, ?, ?, ?, ?)"));
    for (const NewSubmap& submap : submaps) {
      PORTOLAN_ASSIGN_OR_RETURN(const SubmapId id, InsertSubmap(insert, submap));
      ids.push_back(id);
    }
    return absl::OkStatus();
  }));
  return ids;
}

Status SqliteMapStore::SaveSnapshot(const MapSnapshot& snapshot) {
  const std::lock_guard saved_lock(saved_mutex_);
  const std::vector<EncodedState> states = EncodeChangedStates(snapshot, saved_states_);
  const std::vector<EncodedClosure> closures = EncodeChangedClosures(snapshot, saved_closures_);
  const std::vector<SubmapId> left_over = LeftOver(saved_states_, snapshot);
  const std::lock_guard lock(mutex_);
  PORTOLAN_RETURN_IF_ERROR(WriteLocked([&]() -> Status {
    PORTOLAN_RETURN_IF_ERROR(WriteStates(*database_, states));
    PORTOLAN_RETURN_IF_ERROR(DeleteStates(*database_, left_over));
    PORTOLAN_RETURN_IF_ERROR(WriteClosures(*database_, closures, snapshot));
    return WriteComponents(*database_, snapshot);
  }));
  for (const SubmapId id : left_over) saved_states_.erase(id);
  for (const EncodedState& encoded : states) {
    saved_states_[encoded.state->refined->id] = encoded.state;
  }
  RememberClosures(snapshot);
  return absl::OkStatus();
}

void SqliteMapStore::RememberClosures(const MapSnapshot& snapshot) {
  saved_closures_ = {};
  if (snapshot.closures) saved_closures_.accepted = *snapshot.closures;
  if (snapshot.waiting_closures) saved_closures_.waiting = *snapshot.waiting_closures;
}

Status SqliteMapStore::DropDerived() {
  const std::lock_guard saved_lock(saved_mutex_);
  const std::lock_guard lock(mutex_);
  PORTOLAN_RETURN_IF_ERROR(WriteLocked([&]() -> Status {
    PORTOLAN_RETURN_IF_ERROR(DropDerivedTables(*database_));
    return CreateDerivedTables(*database_);
  }));
  saved_states_.clear();
  saved_closures_ = {};
  return absl::OkStatus();
}

StatusOr<std::vector<SessionRecord>> SqliteMapStore::ReadSessions() {
  std::vector<SessionRecord> sessions;
  PORTOLAN_ASSIGN_OR_RETURN(
      SqliteStatement rows,
      SqliteStatement::Prepare(*database_, "SELECT * FROM session ORDER BY id"));
  while (true) {
    PORTOLAN_ASSIGN_OR_RETURN(const bool has_row, rows.Step());
    if (!has_row) return sessions;
    sessions.push_back(ReadSession(rows));
  }
}

StatusOr<std::vector<StoredSubmap>> SqliteMapStore::ReadSubmaps(
    const std::vector<SessionRecord>& sessions, const SubmapDecoder& decode) {
  std::unordered_map<int64_t, std::shared_ptr<const CameraModel>> cameras;
  for (const SessionRecord& session : sessions) {
    PORTOLAN_ASSIGN_OR_RETURN(CameraModel camera, CameraModel::Create(session.camera));
    cameras[sessions_.at({session.agent, session.session}).id] =
        std::make_shared<const CameraModel>(std::move(camera));
  }
  PORTOLAN_ASSIGN_OR_RETURN(
      SqliteStatement rows,
      SqliteStatement::Prepare(*database_,
                               "SELECT id, session_id, hash, bytes FROM raw_submap ORDER BY id"));
  std::vector<StoredSubmap> submaps;
  while (true) {
    PORTOLAN_ASSIGN_OR_RETURN(const bool has_row, rows.Step());
    if (!has_row) return submaps;
    const std::string_view bytes = rows.ColumnBytes(3);
    const int64_t id = rows.ColumnInteger(0);
    if (AsSigned(HashBytes(bytes)) != rows.ColumnInteger(2)) {
      return absl::DataLossError(absl::StrCat("raw submap ", id, " is damaged (hash differs)"));
    }
    StatusOr<Submap> submap = decode(bytes);
    if (!submap.ok()) {
      return absl::DataLossError(
          absl::StrCat("raw submap ", id, " cannot be read: ", submap.status().ToString()));
    }
    submaps.push_back({SubmapId(id), std::make_shared<const Submap>(*std::move(submap)),
                       cameras[rows.ColumnInteger(1)], static_cast<int64_t>(bytes.size())});
  }
}

StatusOr<StoredMap> SqliteMapStore::Load(const SubmapDecoder& decode) {
  const std::lock_guard saved_lock(saved_mutex_);
  const std::lock_guard lock(mutex_);
  StoredMap map;
  PORTOLAN_ASSIGN_OR_RETURN(map.sessions, ReadSessions());
  PORTOLAN_ASSIGN_OR_RETURN(map.submaps, ReadSubmaps(map.sessions, decode));
  PORTOLAN_ASSIGN_OR_RETURN(map.survey, ReadSurvey(*database_));
  StatusOr<std::shared_ptr<const MapSnapshot>> snapshot = ReadSnapshot(*database_, map.submaps);
  if (!snapshot.ok()) {
    map.derived_problem = snapshot.status().ToString();
    return map;
  }
  map.snapshot = *std::move(snapshot);
  saved_states_.clear();
  saved_closures_ = {};
  if (!map.snapshot) return map;
  for (const auto& state : map.snapshot->submaps) saved_states_[state->refined->id] = state;
  RememberClosures(*map.snapshot);
  return map;
}

StatusOr<std::vector<SubmapId>> SqliteMapStore::SubmapsInBox(ComponentId component,
                                                             const Box& box) {
  const std::lock_guard lock(mutex_);
  PORTOLAN_ASSIGN_OR_RETURN(
      SqliteStatement rows,
      SqliteStatement::Prepare(*database_,
                               "SELECT submap_id FROM landmark_bounds "
                               "WHERE max_x >= ? AND min_x <= ? AND max_y >= ? AND min_y <= ? "
                               "AND max_z >= ? AND min_z <= ? AND component_id = ? "
                               "ORDER BY submap_id"));
  for (int axis = 0; axis < 3; ++axis) {
    rows.BindReal(1 + 2 * axis, box.min[axis]);
    rows.BindReal(2 + 2 * axis, box.max[axis]);
  }
  rows.BindInteger(7, component.value());
  std::vector<SubmapId> ids;
  while (true) {
    PORTOLAN_ASSIGN_OR_RETURN(const bool has_row, rows.Step());
    if (!has_row) return ids;
    ids.emplace_back(rows.ColumnInteger(0));
  }
}

Status SqliteMapStore::SaveSurvey(const Survey& survey) {
  const std::lock_guard lock(mutex_);
  return WriteLocked([&] { return WriteSurvey(*database_, survey); });
}

StatusOr<int64_t> SqliteMapStore::SizeBytes() { return size_bytes_.load(); }

}  // namespace portolan
