#include "server/store/derived_tables.h"

#include <utility>

#include "absl/strings/str_cat.h"
#include "server/store/blob.h"
#include "server/store/schema.h"
#include "server/store/state_codec.h"

namespace portolan {
namespace {

// The waiting closures are numbered from here, so that a new accepted one moves none of them.
constexpr int64_t kFirstWaitingPosition = int64_t{1} << 40;

using SubmapsById = std::unordered_map<int64_t, const StoredSubmap*>;

Status WriteRefined(SqliteStatement& insert, const EncodedState& encoded) {
  const RefinedSubmap& refined = *encoded.state->refined;
  insert.BindInteger(1, refined.id.value());
  insert.BindReal(2, refined.rms_reprojection_px);
  insert.BindText(3, refined.quarantine_reason);
  insert.BindBlob(4, encoded.refined);
  return insert.Run();
}

Status WriteState(SqliteStatement& insert, const EncodedState& encoded) {
  const SubmapState& state = *encoded.state;
  insert.BindInteger(1, state.refined->id.value());
  insert.BindInteger(2, state.component.value());
  insert.BindInteger(3, static_cast<int64_t>(state.moved_at_version));
  insert.BindBlob(4, encoded.pose);
  insert.BindInteger(5, static_cast<int64_t>(state.landmarks.size()));
  insert.BindBlob(6, encoded.landmarks);
  return insert.Run();
}

Status WriteBounds(SqliteStatement& insert, SqliteStatement& remove, const SubmapState& state) {
  remove.BindInteger(1, state.refined->id.value());
  PORTOLAN_RETURN_IF_ERROR(remove.Run());
  if (state.landmarks.empty()) return absl::OkStatus();
  Eigen::AlignedBox3d bounds;
  for (const FusedLandmark& landmark : state.landmarks) bounds.extend(landmark.point_in_world);
  insert.BindInteger(1, state.refined->id.value());
  for (int axis = 0; axis < 3; ++axis) {
    insert.BindReal(2 + 2 * axis, bounds.min()[axis]);
    insert.BindReal(3 + 2 * axis, bounds.max()[axis]);
  }
  insert.BindInteger(8, state.component.value());
  return insert.Run();
}

StatusOr<std::shared_ptr<const RefinedSubmap>> ReadRefined(const SqliteStatement& row, int column,
                                                           const StoredSubmap& stored) {
  auto refined = std::make_shared<RefinedSubmap>();
  refined->id = stored.id;
  refined->raw = stored.submap;
  refined->camera = stored.camera;
  refined->rms_reprojection_px = row.ColumnReal(column);
  refined->quarantine_reason = std::string(row.ColumnBytes(column + 1));
  PORTOLAN_RETURN_IF_ERROR(DecodeRefined(row.ColumnBytes(column + 2), refined.get()));
  return refined;
}

StatusOr<std::shared_ptr<const SubmapState>> ReadState(const SqliteStatement& row,
                                                       const SubmapsById& submaps) {
  const auto stored = submaps.find(row.ColumnInteger(0));
  if (stored == submaps.end()) {
    return absl::DataLossError(absl::StrCat("state of unknown submap ", row.ColumnInteger(0)));
  }
  auto state = std::make_shared<SubmapState>();
  state->component = ComponentId(row.ColumnInteger(1));
  state->moved_at_version = static_cast<uint64_t>(row.ColumnInteger(2));
  PORTOLAN_ASSIGN_OR_RETURN(state->landmarks, DecodeLandmarks(row.ColumnBytes(4)));
  PORTOLAN_ASSIGN_OR_RETURN(state->refined, ReadRefined(row, 5, *stored->second));
  PORTOLAN_RETURN_IF_ERROR(DecodePose(row.ColumnBytes(3), state.get()));
  if (state->world_from_camera.size() != stored->second->submap->keyframes.size()) {
    return absl::DataLossError(absl::StrCat("keyframe poses of submap ", row.ColumnInteger(0)));
  }
  return state;
}

Status ReadStates(SqliteDatabase& database, const SubmapsById& submaps, MapSnapshot* snapshot) {
  PORTOLAN_ASSIGN_OR_RETURN(
      SqliteStatement rows,
      SqliteStatement::Prepare(
          database,
          "SELECT submap_id, component_id, moved_at_version, pose, landmarks, "
          "rms_reprojection_px, quarantine_reason, estimate "
          "FROM submap_state JOIN refined_submap USING (submap_id) ORDER BY submap_id"));
  while (true) {
    PORTOLAN_ASSIGN_OR_RETURN(const bool has_row, rows.Step());
    if (!has_row) return absl::OkStatus();
    PORTOLAN_ASSIGN_OR_RETURN(auto state, ReadState(rows, submaps));
    snapshot->submaps.push_back(std::move(state));
  }
}

Status ReadClosures(SqliteDatabase& database, MapSnapshot* snapshot) {
  auto accepted = std::make_shared<ClosureList>();
  auto waiting = std::make_shared<ClosureList>();
  PORTOLAN_ASSIGN_OR_RETURN(
      SqliteStatement rows,
      SqliteStatement::Prepare(
          database,
          "SELECT accepted, submap_a, submap_b, estimate FROM closure ORDER BY position"));
  while (true) {
    PORTOLAN_ASSIGN_OR_RETURN(const bool has_row, rows.Step());
    if (!has_row) break;
    Closure closure;
    closure.a = SubmapId(rows.ColumnInteger(1));
    closure.b = SubmapId(rows.ColumnInteger(2));
    PORTOLAN_RETURN_IF_ERROR(DecodeClosure(rows.ColumnBytes(3), &closure));
    (rows.ColumnInteger(0) != 0 ? accepted : waiting)->push_back(std::move(closure));
  }
  snapshot->closures = std::move(accepted);
  snapshot->waiting_closures = std::move(waiting);
  return absl::OkStatus();
}

Status ReadComponents(SqliteDatabase& database, MapSnapshot* snapshot) {
  PORTOLAN_ASSIGN_OR_RETURN(
      SqliteStatement rows,
      SqliteStatement::Prepare(
          database, "SELECT id, metric, gravity_aligned, georeference FROM component ORDER BY id"));
  while (true) {
    PORTOLAN_ASSIGN_OR_RETURN(const bool has_row, rows.Step());
    if (!has_row) return absl::OkStatus();
    ComponentState component;
    component.id = ComponentId(rows.ColumnInteger(0));
    component.metric = rows.ColumnInteger(1) != 0;
    component.gravity_aligned = rows.ColumnInteger(2) != 0;
    PORTOLAN_RETURN_IF_ERROR(DecodeGeoreference(rows.ColumnBytes(3), &component));
    snapshot->components.push_back(std::move(component));
  }
}

}  // namespace

std::vector<EncodedState> EncodeChangedStates(const MapSnapshot& snapshot,
                                              const SubmapStates& saved) {
  std::vector<EncodedState> changed;
  for (const auto& state : snapshot.submaps) {
    const auto found = saved.find(state->refined->id);
    const bool is_known = found != saved.end();
    if (is_known && found->second == state) continue;
    EncodedState& encoded = changed.emplace_back();
    encoded.state = state;
    if (!is_known || found->second->refined != state->refined) {
      encoded.refined = EncodeRefined(*state->refined);
    }
    encoded.pose = EncodePose(*state);
    encoded.landmarks = EncodeLandmarks(state->landmarks);
  }
  return changed;
}

std::vector<EncodedClosure> EncodeChangedClosures(const MapSnapshot& snapshot,
                                                  const SavedClosures& saved) {
  std::vector<EncodedClosure> encoded;
  for (const bool accepted : {true, false}) {
    const auto& closures = accepted ? snapshot.closures : snapshot.waiting_closures;
    const ClosureList& before = accepted ? saved.accepted : saved.waiting;
    if (!closures) continue;
    for (size_t i = 0; i < closures->size(); ++i) {
      if (i < before.size() && before.shared(i) == closures->shared(i)) continue;
      encoded.push_back({accepted, i, closures->shared(i), EncodeClosure((*closures)[i])});
    }
  }
  return encoded;
}

Status WriteStates(SqliteDatabase& database, const std::vector<EncodedState>& states) {
  PORTOLAN_ASSIGN_OR_RETURN(
      SqliteStatement refined,
      SqliteStatement::Prepare(database, "REPLACE INTO refined_submap VALUES (?, ?, ?, ?)"));
  PORTOLAN_ASSIGN_OR_RETURN(
      SqliteStatement pose,
      SqliteStatement::Prepare(database, "REPLACE INTO submap_state VALUES (?, ?, ?, ?, ?, ?)"));
  PORTOLAN_ASSIGN_OR_RETURN(
      SqliteStatement bounds,
      SqliteStatement::Prepare(database,
                               "INSERT INTO landmark_bounds VALUES (?, ?, ?, ?, ?, ?, ?, ?)"));
  PORTOLAN_ASSIGN_OR_RETURN(
      SqliteStatement no_bounds,
      SqliteStatement::Prepare(database, "DELETE FROM landmark_bounds WHERE submap_id = ?"));
  for (const EncodedState& encoded : states) {
    if (!encoded.refined.empty()) PORTOLAN_RETURN_IF_ERROR(WriteRefined(refined, encoded));
    PORTOLAN_RETURN_IF_ERROR(WriteState(pose, encoded));
    PORTOLAN_RETURN_IF_ERROR(WriteBounds(bounds, no_bounds, *encoded.state));
  }
  return absl::OkStatus();
}

Status DeleteStates(SqliteDatabase& database, const std::vector<SubmapId>& submaps) {
  if (submaps.empty()) return absl::OkStatus();
  for (const char* table : {"refined_submap", "submap_state", "landmark_bounds"}) {
    PORTOLAN_ASSIGN_OR_RETURN(
        SqliteStatement remove,
        SqliteStatement::Prepare(database,
                                 absl::StrCat("DELETE FROM ", table, " WHERE submap_id = ?")));
    for (const SubmapId id : submaps) {
      remove.BindInteger(1, id.value());
      PORTOLAN_RETURN_IF_ERROR(remove.Run());
    }
  }
  return absl::OkStatus();
}

Status WriteClosures(SqliteDatabase& database, const std::vector<EncodedClosure>& closures,
                     const MapSnapshot& snapshot) {
  PORTOLAN_ASSIGN_OR_RETURN(
      SqliteStatement insert,
      SqliteStatement::Prepare(database, "REPLACE INTO closure VALUES (?, ?, ?, ?, ?)"));
  for (const EncodedClosure& encoded : closures) {
    const int64_t first = encoded.accepted ? 0 : kFirstWaitingPosition;
    insert.BindInteger(1, first + static_cast<int64_t>(encoded.position));
    insert.BindInteger(2, encoded.accepted);
    insert.BindInteger(3, encoded.closure->a.value());
    insert.BindInteger(4, encoded.closure->b.value());
    insert.BindBlob(5, encoded.estimate);
    PORTOLAN_RETURN_IF_ERROR(insert.Run());
  }
  const auto size_of = [](const std::shared_ptr<const ClosureList>& list) {
    return list ? static_cast<int64_t>(list->size()) : 0;
  };
  return database.Execute(absl::StrCat("DELETE FROM closure WHERE position >= ",
                                       kFirstWaitingPosition + size_of(snapshot.waiting_closures),
                                       " OR (position >= ", size_of(snapshot.closures),
                                       " AND position < ", kFirstWaitingPosition, ")"));
}

Status WriteComponents(SqliteDatabase& database, const MapSnapshot& snapshot) {
  PORTOLAN_RETURN_IF_ERROR(database.Execute("DELETE FROM component"));
  PORTOLAN_ASSIGN_OR_RETURN(
      SqliteStatement insert,
      SqliteStatement::Prepare(database, "INSERT INTO component VALUES (?, ?, ?, ?)"));
  for (const ComponentState& component : snapshot.components) {
    insert.BindInteger(1, component.id.value());
    insert.BindInteger(2, component.metric);
    insert.BindInteger(3, component.gravity_aligned);
    const std::string georeference = EncodeGeoreference(component);
    insert.BindBlob(4, georeference);
    PORTOLAN_RETURN_IF_ERROR(insert.Run());
  }
  return database.Execute(absl::StrCat("REPLACE INTO map_state VALUES ('version', ",
                                       static_cast<int64_t>(snapshot.version), ")"));
}

StatusOr<std::shared_ptr<const MapSnapshot>> ReadSnapshot(
    SqliteDatabase& database, const std::vector<StoredSubmap>& submaps) {
  PORTOLAN_ASSIGN_OR_RETURN(
      const int64_t derived_version,
      database.QueryInteger("SELECT value FROM map_state WHERE key = 'derived_version'"));
  if (derived_version != kDerivedVersion) {
    return absl::DataLossError(absl::StrCat("derived tables of version ", derived_version));
  }
  const StatusOr<int64_t> version =
      database.QueryInteger("SELECT value FROM map_state WHERE key = 'version'");
  if (absl::IsNotFound(version.status())) return std::shared_ptr<const MapSnapshot>();
  PORTOLAN_RETURN_IF_ERROR(version.status());
  SubmapsById submaps_by_id;
  for (const StoredSubmap& submap : submaps) submaps_by_id[submap.id.value()] = &submap;
  auto snapshot = std::make_shared<MapSnapshot>();
  snapshot->version = static_cast<uint64_t>(*version);
  PORTOLAN_RETURN_IF_ERROR(ReadStates(database, submaps_by_id, snapshot.get()));
  PORTOLAN_RETURN_IF_ERROR(ReadClosures(database, snapshot.get()));
  PORTOLAN_RETURN_IF_ERROR(ReadComponents(database, snapshot.get()));
  return snapshot;
}

}  // namespace portolan
