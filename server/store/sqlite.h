// RAII over SQLite's C interface: a connection, prepared statements, transactions. Every error is
// a Status; the messages carry SQLite's own text.
#ifndef PORTOLAN_SERVER_STORE_SQLITE_H_
#define PORTOLAN_SERVER_STORE_SQLITE_H_

#include <sqlite3.h>

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "common/base/status.h"

namespace portolan {

// One connection. Thread-compatible; statements and transactions must not outlive it.
class SqliteDatabase {
 public:
  // `vfs` names the operating system layer, empty for SQLite's default (tests inject faults there).
  static StatusOr<std::unique_ptr<SqliteDatabase>> Open(const std::string& path,
                                                        const std::string& vfs);
  ~SqliteDatabase();
  SqliteDatabase(const SqliteDatabase&) = delete;
  SqliteDatabase& operator=(const SqliteDatabase&) = delete;

  // Runs one or more statements whose results are of no interest.
  Status Execute(const std::string& sql);
  // First column of the first row.
  StatusOr<int64_t> QueryInteger(const std::string& sql);

  // The Status of a failed SQLite call: DataLoss for damaged and foreign files, Unavailable for a
  // file in use, ResourceExhausted for a full disk, else Internal.
  Status ErrorStatus(int code, std::string_view context) const;

  sqlite3* handle() const { return handle_; }

 private:
  explicit SqliteDatabase(sqlite3* handle) : handle_(handle) {}

  sqlite3* handle_;
};

// A prepared statement, reusable. Parameters and columns count from 1 and 0, as in SQLite. A bind
// error is reported by the next Step.
class SqliteStatement {
 public:
  static StatusOr<SqliteStatement> Prepare(const SqliteDatabase& database, std::string_view sql);
  SqliteStatement(SqliteStatement&& other) noexcept;
  SqliteStatement& operator=(SqliteStatement&& other) noexcept;
  ~SqliteStatement();

  void BindInteger(int parameter, int64_t value);
  void BindReal(int parameter, double value);
  // The bytes must live until the statement is reset.
  void BindText(int parameter, std::string_view text);
  void BindBlob(int parameter, std::string_view bytes);

  // True: a row is there to be read. False: done, and the statement is reset.
  StatusOr<bool> Step();
  // Steps to the end, ignoring rows, and resets.
  Status Run();
  void Reset();

  int64_t ColumnInteger(int column) const;
  double ColumnReal(int column) const;
  // Valid until the next Step or Reset.
  std::string_view ColumnBytes(int column) const;

 private:
  SqliteStatement(const SqliteDatabase& database, sqlite3_stmt* statement)
      : database_(&database), statement_(statement) {}
  void Note(int code);

  const SqliteDatabase* database_;
  sqlite3_stmt* statement_;
  int bind_error_ = SQLITE_OK;
};

// A write transaction, rolled back on destruction unless committed.
class SqliteTransaction {
 public:
  static StatusOr<SqliteTransaction> Begin(SqliteDatabase& database);
  SqliteTransaction(SqliteTransaction&& other) noexcept;
  SqliteTransaction& operator=(SqliteTransaction&&) = delete;
  ~SqliteTransaction();

  Status Commit();

 private:
  explicit SqliteTransaction(SqliteDatabase& database) : database_(&database) {}

  SqliteDatabase* database_;  // null once committed
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_STORE_SQLITE_H_
