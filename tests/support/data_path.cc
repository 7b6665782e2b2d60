#include "tests/support/data_path.h"

#include <cstdlib>

namespace portolan {

std::optional<std::filesystem::path> RealDataPath(std::string_view relative) {
  const char* root = std::getenv("PORTOLAN_DATA");
  const std::filesystem::path path =
      std::filesystem::path(root != nullptr && *root != '\0' ? root : "../shared/data") / relative;
  std::error_code error;
  if (!std::filesystem::exists(path, error)) return std::nullopt;
  return path;
}

}  // namespace portolan
