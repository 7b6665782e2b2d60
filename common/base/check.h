// PORTOLAN_CHECK: for our own mistakes only. Nothing that comes from a file, the network or an
// operator may reach one.
#ifndef PORTOLAN_COMMON_BASE_CHECK_H_
#define PORTOLAN_COMMON_BASE_CHECK_H_

namespace portolan {

[[noreturn]] void CheckFailed(const char* file, int line, const char* condition);

}  // namespace portolan

#define PORTOLAN_CHECK(condition)                                        \
  do {                                                                   \
    if (!(condition)) ::portolan::CheckFailed(__FILE__, __LINE__, #condition); \
  } while (false)

#ifdef NDEBUG
#define PORTOLAN_DCHECK(condition) \
  do {                             \
  } while (false && (condition))
#else
#define PORTOLAN_DCHECK(condition) PORTOLAN_CHECK(condition)
#endif

#endif  // PORTOLAN_COMMON_BASE_CHECK_H_
