#include "agent/uplink/durable_file.h"

#include <fstream>

#include "tests/support/matchers.h"
#include "tests/support/temp_dir.h"

namespace portolan {
namespace {

std::string RawBytes(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

void WriteRaw(const std::filesystem::path& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

TEST(DurableFile, KeepsAnyContent) {
  const TempDir dir;
  for (const std::string& content :
       {std::string(), std::string("\0a\n", 3), std::string(99999, 'x')}) {
    ASSERT_THAT(WriteDurably(dir / "f", content), IsOk());
    const auto read = ReadDurable(dir / "f");
    ASSERT_THAT(read, IsOk());
    EXPECT_EQ(*read, content);
  }
  EXPECT_FALSE(std::filesystem::exists(dir / "f.tmp"));
}

TEST(DurableFile, DetectsEveryTruncation) {
  const TempDir dir;
  ASSERT_THAT(WriteDurably(dir / "f", "some content"), IsOk());
  const std::string bytes = RawBytes(dir / "f");
  for (size_t size = 0; size < bytes.size(); ++size) {
    WriteRaw(dir / "f", bytes.substr(0, size));
    EXPECT_THAT(ReadDurable(dir / "f"), StatusIs(absl::StatusCode::kDataLoss)) << size;
  }
  WriteRaw(dir / "f", bytes + "x");
  EXPECT_THAT(ReadDurable(dir / "f"), StatusIs(absl::StatusCode::kDataLoss));
}

TEST(DurableFile, DetectsEveryFlippedBit) {
  const TempDir dir;
  ASSERT_THAT(WriteDurably(dir / "f", "some content"), IsOk());
  const std::string bytes = RawBytes(dir / "f");
  for (size_t bit = 0; bit < 8 * bytes.size(); ++bit) {
    std::string damaged = bytes;
    damaged[bit / 8] = static_cast<char>(damaged[bit / 8] ^ (1 << (bit % 8)));
    WriteRaw(dir / "f", damaged);
    EXPECT_THAT(ReadDurable(dir / "f"), StatusIs(absl::StatusCode::kDataLoss)) << bit;
  }
}

TEST(DurableFile, ReportsMissingFilesAndFolders) {
  const TempDir dir;
  EXPECT_THAT(ReadDurable(dir / "none"), StatusIs(absl::StatusCode::kNotFound));
  EXPECT_FALSE(WriteDurably(dir / "none/f", "x").ok());
}

}  // namespace
}  // namespace portolan
