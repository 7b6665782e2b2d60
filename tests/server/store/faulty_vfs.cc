#include "tests/server/store/faulty_vfs.h"

#include <sqlite3.h>

#include <climits>
#include <new>

namespace portolan::testing {
namespace {

struct State {
  int operations = 0;
  int fail_after = INT_MAX;
  int error = SQLITE_IOERR_WRITE;
};
State g_state;

// Counts a write operation; SQLITE_OK or the injected error.
int NextOperation() {
  return g_state.operations++ < g_state.fail_after ? SQLITE_OK : g_state.error;
}

// An open file: our table of methods in front of the real file, which lies behind this struct.
struct FaultyFile {
  sqlite3_file base;
  sqlite3_file* real() { return reinterpret_cast<sqlite3_file*>(this + 1); }
};

FaultyFile* Cast(sqlite3_file* file) { return reinterpret_cast<FaultyFile*>(file); }
sqlite3_file* Real(sqlite3_file* file) { return Cast(file)->real(); }
const sqlite3_io_methods* Methods(sqlite3_file* file) { return Real(file)->pMethods; }

int Close(sqlite3_file* f) { return Methods(f)->xClose(Real(f)); }
int Read(sqlite3_file* f, void* data, int size, sqlite3_int64 offset) {
  return Methods(f)->xRead(Real(f), data, size, offset);
}
int Write(sqlite3_file* f, const void* data, int size, sqlite3_int64 offset) {
  const int error = NextOperation();
  return error != SQLITE_OK ? error : Methods(f)->xWrite(Real(f), data, size, offset);
}
int Truncate(sqlite3_file* f, sqlite3_int64 size) {
  const int error = NextOperation();
  return error != SQLITE_OK ? error : Methods(f)->xTruncate(Real(f), size);
}
int Sync(sqlite3_file* f, int flags) {
  const int error = NextOperation();
  return error != SQLITE_OK ? error : Methods(f)->xSync(Real(f), flags);
}
int FileSize(sqlite3_file* f, sqlite3_int64* size) { return Methods(f)->xFileSize(Real(f), size); }
int Lock(sqlite3_file* f, int level) { return Methods(f)->xLock(Real(f), level); }
int Unlock(sqlite3_file* f, int level) { return Methods(f)->xUnlock(Real(f), level); }
int CheckReservedLock(sqlite3_file* f, int* result) {
  return Methods(f)->xCheckReservedLock(Real(f), result);
}
int FileControl(sqlite3_file* f, int operation, void* argument) {
  return Methods(f)->xFileControl(Real(f), operation, argument);
}
int SectorSize(sqlite3_file* f) { return Methods(f)->xSectorSize(Real(f)); }
int DeviceCharacteristics(sqlite3_file* f) { return Methods(f)->xDeviceCharacteristics(Real(f)); }

// Version 1: no shared memory, which a store that holds its file exclusively does not need.
const sqlite3_io_methods kMethods = {1,
                                     Close,
                                     Read,
                                     Write,
                                     Truncate,
                                     Sync,
                                     FileSize,
                                     Lock,
                                     Unlock,
                                     CheckReservedLock,
                                     FileControl,
                                     SectorSize,
                                     DeviceCharacteristics,
                                     nullptr,
                                     nullptr,
                                     nullptr,
                                     nullptr,
                                     nullptr,
                                     nullptr};

sqlite3_vfs* g_real_vfs = nullptr;

int Open(sqlite3_vfs*, const char* path, sqlite3_file* file, int flags, int* out_flags) {
  FaultyFile* faulty = new (file) FaultyFile{};
  const int code = g_real_vfs->xOpen(g_real_vfs, path, faulty->real(), flags, out_flags);
  if (code == SQLITE_OK) faulty->base.pMethods = &kMethods;
  return code;
}

}  // namespace

const char* FaultyVfs::name() {
  static sqlite3_vfs vfs = [] {
    g_real_vfs = sqlite3_vfs_find(nullptr);
    sqlite3_vfs wrapped = *g_real_vfs;
    wrapped.zName = "portolan_faulty";
    wrapped.szOsFile = static_cast<int>(sizeof(FaultyFile)) + g_real_vfs->szOsFile;
    wrapped.xOpen = Open;
    wrapped.pNext = nullptr;
    return wrapped;
  }();
  static const int registered = sqlite3_vfs_register(&vfs, 0);
  return registered == SQLITE_OK ? vfs.zName : "unregistered";
}

void FaultyVfs::FailAfter(int operations, Fault fault) {
  g_state = {0, operations, fault == Fault::kDiskFull ? SQLITE_FULL : SQLITE_IOERR_WRITE};
}

void FaultyVfs::Heal() { g_state = {}; }

int FaultyVfs::operation_count() { return g_state.operations; }

}  // namespace portolan::testing
