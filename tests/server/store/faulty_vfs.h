// An operating system layer for SQLite that fails on demand, as a disk does.
#ifndef PORTOLAN_TESTS_SERVER_STORE_FAULTY_VFS_H_
#define PORTOLAN_TESTS_SERVER_STORE_FAULTY_VFS_H_

namespace portolan::testing {

// Wraps SQLite's default layer under the name name(). Every file operation that writes or syncs
// counts; once `fail_after` more have succeeded, each further one fails.
class FaultyVfs {
 public:
  enum class Fault { kDiskFull, kInputOutputError };

  // Registers the layer on the first call; there is one, not thread-safe.
  static const char* name();
  static void FailAfter(int operations, Fault fault);
  static void Heal();
  // Write operations since the last FailAfter or Heal.
  static int operation_count();
};

}  // namespace portolan::testing

#endif  // PORTOLAN_TESTS_SERVER_STORE_FAULTY_VFS_H_
