#include "common/base/logging.h"

#include <atomic>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <mutex>
#include <utility>

namespace portolan {
namespace {

std::atomic<LogLevel> g_level{LogLevel::kInfo};

struct SinkHolder {
  std::mutex mutex;
  LogSink sink;  // guarded by mutex
};

// Never destroyed: threads may log while the program ends.
SinkHolder& Sink() {
  static SinkHolder* holder = new SinkHolder;
  return *holder;
}

void WriteToStandardError(LogLevel level, std::string_view text) {
  const auto now = std::chrono::system_clock::now();
  const std::time_t seconds = std::chrono::system_clock::to_time_t(now);
  const auto since_epoch =
      std::chrono::duration_cast<std::chrono::milliseconds>(now.time_since_epoch());
  std::tm local{};
  localtime_r(&seconds, &local);
  std::fprintf(stderr, "%c %02d:%02d:%02d.%03d %.*s\n", "DIWE"[static_cast<int>(level)],
               local.tm_hour, local.tm_min, local.tm_sec,
               static_cast<int>(since_epoch.count() % 1000), static_cast<int>(text.size()),
               text.data());
}

}  // namespace

StatusOr<LogLevel> ParseLogLevel(std::string_view name) {
  constexpr std::pair<std::string_view, LogLevel> kNames[] = {{"debug", LogLevel::kDebug},
                                                              {"info", LogLevel::kInfo},
                                                              {"warning", LogLevel::kWarning},
                                                              {"error", LogLevel::kError},
                                                              {"none", LogLevel::kNone}};
  for (const auto& [known, level] : kNames) {
    if (name == known) return level;
  }
  return absl::InvalidArgumentError(
      Concat("unknown log level '", name, "'; one of debug, info, warning, error, none"));
}

void SetLogLevel(LogLevel level) { g_level.store(level, std::memory_order_relaxed); }

bool IsLogged(LogLevel level) {
  return level >= g_level.load(std::memory_order_relaxed) && level < LogLevel::kNone;
}

void SetLogSink(LogSink sink) {
  std::lock_guard lock(Sink().mutex);
  Sink().sink = std::move(sink);
}

void LogLine(LogLevel level, std::string_view text) {
  if (!IsLogged(level)) return;
  std::lock_guard lock(Sink().mutex);
  if (Sink().sink) {
    Sink().sink(level, text);
  } else {
    WriteToStandardError(level, text);
  }
}

}  // namespace portolan
