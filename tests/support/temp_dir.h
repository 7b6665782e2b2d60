// A fresh folder that is removed with all it holds when the object goes.
#ifndef PORTOLAN_TESTS_SUPPORT_TEMP_DIR_H_
#define PORTOLAN_TESTS_SUPPORT_TEMP_DIR_H_

#include <filesystem>
#include <string_view>

namespace portolan {

class TempDir {
 public:
  TempDir();
  ~TempDir();
  TempDir(const TempDir&) = delete;
  TempDir& operator=(const TempDir&) = delete;

  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path operator/(std::string_view name) const { return path_ / name; }

  // Writes a text file under the folder, creating its parents; returns its path.
  std::filesystem::path Write(std::string_view name, std::string_view text) const;

 private:
  std::filesystem::path path_;
};

}  // namespace portolan

#endif  // PORTOLAN_TESTS_SUPPORT_TEMP_DIR_H_
