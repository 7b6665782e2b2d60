#include "tests/support/temp_dir.h"

#include <cstdlib>
#include <fstream>
#include <string>

#include "common/base/check.h"

namespace portolan {

TempDir::TempDir() {
  std::string name = (std::filesystem::temp_directory_path() / "portolan_test_XXXXXX").string();
  PORTOLAN_CHECK(mkdtemp(name.data()) != nullptr);
  path_ = name;
}

TempDir::~TempDir() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
}

std::filesystem::path TempDir::Write(std::string_view name, std::string_view text) const {
  const std::filesystem::path path = path_ / name;
  std::filesystem::create_directories(path.parent_path());
  std::ofstream(path, std::ios::binary) << text;
  return path;
}

}  // namespace portolan
