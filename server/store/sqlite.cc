#include "server/store/sqlite.h"

#include <utility>

#include "absl/strings/str_cat.h"

namespace portolan {

StatusOr<std::unique_ptr<SqliteDatabase>> SqliteDatabase::Open(const std::string& path,
                                                               const std::string& vfs) {
  sqlite3* handle = nullptr;
  const int code = sqlite3_open_v2(
      path.c_str(), &handle, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_FULLMUTEX,
      vfs.empty() ? nullptr : vfs.c_str());
  std::unique_ptr<SqliteDatabase> database(new SqliteDatabase(handle));
  if (code != SQLITE_OK) return database->ErrorStatus(code, absl::StrCat("cannot open ", path));
  sqlite3_extended_result_codes(handle, 1);
  return database;
}

SqliteDatabase::~SqliteDatabase() { sqlite3_close_v2(handle_); }

Status SqliteDatabase::Execute(const std::string& sql) {
  const int code = sqlite3_exec(handle_, sql.c_str(), nullptr, nullptr, nullptr);
  return code == SQLITE_OK ? absl::OkStatus() : ErrorStatus(code, sql.substr(0, 60));
}

StatusOr<int64_t> SqliteDatabase::QueryInteger(const std::string& sql) {
  PORTOLAN_ASSIGN_OR_RETURN(SqliteStatement statement, SqliteStatement::Prepare(*this, sql));
  PORTOLAN_ASSIGN_OR_RETURN(const bool has_row, statement.Step());
  if (!has_row) return absl::NotFoundError(absl::StrCat("no row: ", sql));
  return statement.ColumnInteger(0);
}

Status SqliteDatabase::ErrorStatus(int code, std::string_view context) const {
  const std::string message =
      absl::StrCat(std::string(context), ": ", handle_ ? sqlite3_errmsg(handle_) : "out of memory",
                   " (SQLite error ", code, ")");
  switch (code & 0xff) {
    case SQLITE_CORRUPT:
    case SQLITE_NOTADB:
      return absl::DataLossError(message);
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
      return absl::UnavailableError(message);
    case SQLITE_FULL:
      return absl::ResourceExhaustedError(message);
    case SQLITE_CANTOPEN:
      return absl::NotFoundError(message);
    case SQLITE_PERM:
    case SQLITE_READONLY:
      return absl::PermissionDeniedError(message);
    default:
      return absl::InternalError(message);
  }
}

StatusOr<SqliteStatement> SqliteStatement::Prepare(const SqliteDatabase& database,
                                                   std::string_view sql) {
  sqlite3_stmt* statement = nullptr;
  const int code = sqlite3_prepare_v2(database.handle(), sql.data(), static_cast<int>(sql.size()),
                                      &statement, nullptr);
  if (code != SQLITE_OK) return database.ErrorStatus(code, sql.substr(0, 60));
  return SqliteStatement(database, statement);
}

SqliteStatement::SqliteStatement(SqliteStatement&& other) noexcept
    : database_(other.database_),
      statement_(std::exchange(other.statement_, nullptr)),
      bind_error_(other.bind_error_) {}

SqliteStatement& SqliteStatement::operator=(SqliteStatement&& other) noexcept {
  std::swap(database_, other.database_);
  std::swap(statement_, other.statement_);
  std::swap(bind_error_, other.bind_error_);
  return *this;
}

SqliteStatement::~SqliteStatement() { sqlite3_finalize(statement_); }

void SqliteStatement::Note(int code) {
  if (code != SQLITE_OK && bind_error_ == SQLITE_OK) bind_error_ = code;
}

void SqliteStatement::BindInteger(int parameter, int64_t value) {
  Note(sqlite3_bind_int64(statement_, parameter, value));
}

void SqliteStatement::BindReal(int parameter, double value) {
  Note(sqlite3_bind_double(statement_, parameter, value));
}

void SqliteStatement::BindText(int parameter, std::string_view text) {
  // A null pointer would bind NULL instead of the empty text.
  Note(sqlite3_bind_text64(statement_, parameter, text.data() ? text.data() : "", text.size(),
                           SQLITE_STATIC, SQLITE_UTF8));
}

void SqliteStatement::BindBlob(int parameter, std::string_view bytes) {
  Note(sqlite3_bind_blob64(statement_, parameter, bytes.data() ? bytes.data() : "", bytes.size(),
                           SQLITE_STATIC));
}

StatusOr<bool> SqliteStatement::Step() {
  const int code = bind_error_ != SQLITE_OK ? bind_error_ : sqlite3_step(statement_);
  if (code == SQLITE_ROW) return true;
  if (code == SQLITE_DONE) {
    Reset();
    return false;
  }
  const Status status = database_->ErrorStatus(code, sqlite3_sql(statement_));
  Reset();
  return status;
}

Status SqliteStatement::Run() {
  while (true) {
    PORTOLAN_ASSIGN_OR_RETURN(const bool has_row, Step());
    if (!has_row) return absl::OkStatus();
  }
}

void SqliteStatement::Reset() {
  sqlite3_reset(statement_);
  sqlite3_clear_bindings(statement_);
  bind_error_ = SQLITE_OK;
}

int64_t SqliteStatement::ColumnInteger(int column) const {
  return sqlite3_column_int64(statement_, column);
}

double SqliteStatement::ColumnReal(int column) const {
  return sqlite3_column_double(statement_, column);
}

std::string_view SqliteStatement::ColumnBytes(int column) const {
  const void* bytes = sqlite3_column_blob(statement_, column);
  const int size = sqlite3_column_bytes(statement_, column);
  return bytes ? std::string_view(static_cast<const char*>(bytes), size) : std::string_view();
}

StatusOr<SqliteTransaction> SqliteTransaction::Begin(SqliteDatabase& database) {
  PORTOLAN_RETURN_IF_ERROR(database.Execute("BEGIN IMMEDIATE"));
  return SqliteTransaction(database);
}

SqliteTransaction::SqliteTransaction(SqliteTransaction&& other) noexcept
    : database_(std::exchange(other.database_, nullptr)) {}

SqliteTransaction::~SqliteTransaction() {
  // SQLite may have rolled back by itself after an input/output error.
  if (database_ && sqlite3_get_autocommit(database_->handle()) == 0) {
    database_->Execute("ROLLBACK").IgnoreError();
  }
}

Status SqliteTransaction::Commit() {
  PORTOLAN_RETURN_IF_ERROR(database_->Execute("COMMIT"));
  database_ = nullptr;
  return absl::OkStatus();
}

}  // namespace portolan
