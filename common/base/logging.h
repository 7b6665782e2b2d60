// Leveled log lines on standard error: "I 12:34:56.789 text". Thread-safe: a line is written whole.
//   LogInfo("opened ", path, ", ", count, " frames");   // arguments as Concat takes them
#ifndef PORTOLAN_COMMON_BASE_LOGGING_H_
#define PORTOLAN_COMMON_BASE_LOGGING_H_

#include <functional>
#include <string_view>

#include "common/base/concat.h"
#include "common/base/status.h"

namespace portolan {

enum class LogLevel { kDebug = 0, kInfo = 1, kWarning = 2, kError = 3, kNone = 4 };

// "debug", "info", "warning", "error" or "none".
StatusOr<LogLevel> ParseLogLevel(std::string_view name);

// Lines below the level are dropped; kInfo at start.
void SetLogLevel(LogLevel level);
bool IsLogged(LogLevel level);

// Takes the lines instead of standard error (an empty function restores it). Called under the
// log's lock: it must not log. For tests and for a terminal that redraws its last line.
using LogSink = std::function<void(LogLevel, std::string_view text)>;
void SetLogSink(LogSink sink);

void LogLine(LogLevel level, std::string_view text);

template <typename... Args>
void LogAt(LogLevel level, const Args&... args) {
  if (IsLogged(level)) LogLine(level, Concat(args...));
}
template <typename... Args>
void LogDebug(const Args&... args) {
  LogAt(LogLevel::kDebug, args...);
}
template <typename... Args>
void LogInfo(const Args&... args) {
  LogAt(LogLevel::kInfo, args...);
}
template <typename... Args>
void LogWarning(const Args&... args) {
  LogAt(LogLevel::kWarning, args...);
}
template <typename... Args>
void LogError(const Args&... args) {
  LogAt(LogLevel::kError, args...);
}

}  // namespace portolan

#endif  // PORTOLAN_COMMON_BASE_LOGGING_H_
