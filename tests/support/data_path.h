// Where the real sequences are: the folder named by the environment variable PORTOLAN_DATA or,
// failing that, ../shared/data relative to the source root (the tests' working directory).
#ifndef PORTOLAN_TESTS_SUPPORT_DATA_PATH_H_
#define PORTOLAN_TESTS_SUPPORT_DATA_PATH_H_

#include <filesystem>
#include <optional>
#include <string_view>

#include "gtest/gtest.h"

namespace portolan {

// RealDataPath("euroc/MH_01_easy_first18s"); no value if it does not exist.
std::optional<std::filesystem::path> RealDataPath(std::string_view relative);

}  // namespace portolan

// Declares `variable` as the path, or skips the test, loudly.
#define PORTOLAN_REAL_DATA_OR_SKIP(variable, relative)                                      \
  const auto variable##_or = ::portolan::RealDataPath(relative);                            \
  if (!variable##_or) {                                                                     \
    GTEST_SKIP() << "*** SKIPPED: no real data '" << (relative)                             \
                 << "'; set PORTOLAN_DATA to the folder of sequences to run this test ***"; \
  }                                                                                         \
  const std::filesystem::path variable = *variable##_or

#endif  // PORTOLAN_TESTS_SUPPORT_DATA_PATH_H_
