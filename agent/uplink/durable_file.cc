#include "agent/uplink/durable_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <iterator>

#include "absl/strings/str_cat.h"
#include "common/wire/crc32c.h"

namespace portolan {
namespace {

constexpr std::string_view kMagic = "PTLNOUT1";
constexpr size_t kHeaderBytes = 20;

Status SystemError(const std::string& action, const std::filesystem::path& path) {
  const int error = errno;
  const std::string text = absl::StrCat(action, " ", path.string(), ": ", std::strerror(error));
  return error == ENOSPC || error == EDQUOT ? absl::ResourceExhaustedError(text)
                                            : absl::UnavailableError(text);
}

class FileDescriptor {
 public:
  explicit FileDescriptor(int fd) : fd_(fd) {}
  ~FileDescriptor() {
    if (fd_ >= 0) ::close(fd_);
  }
  FileDescriptor(const FileDescriptor&) = delete;
  FileDescriptor& operator=(const FileDescriptor&) = delete;
  int get() const { return fd_; }

 private:
  const int fd_;
};

void AppendLittleEndian(uint64_t value, int bytes, std::string* out) {
  for (int i = 0; i < bytes; ++i) out->push_back(static_cast<char>((value >> (8 * i)) & 0xff));
}

uint64_t LittleEndianAt(std::string_view bytes, size_t at, size_t count) {
  uint64_t value = 0;
  for (size_t i = 0; i < count; ++i) {
    value |= static_cast<uint64_t>(static_cast<unsigned char>(bytes[at + i])) << (8 * i);
  }
  return value;
}

Status WriteAll(int fd, std::string_view bytes, const std::filesystem::path& path) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(fd, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) return SystemError("cannot write", path);
    bytes.remove_prefix(static_cast<size_t>(written));
  }
  return absl::OkStatus();
}

Status WriteAndFlush(const std::filesystem::path& path, std::string_view bytes) {
  const FileDescriptor file(::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644));
  if (file.get() < 0) return SystemError("cannot create", path);
  PORTOLAN_RETURN_IF_ERROR(WriteAll(file.get(), bytes, path));
  if (::fsync(file.get()) != 0) return SystemError("cannot flush", path);
  return absl::OkStatus();
}

Status FlushFolder(const std::filesystem::path& folder) {
  const FileDescriptor directory(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (directory.get() < 0 || ::fsync(directory.get()) != 0) {
    return SystemError("cannot flush", folder);
  }
  return absl::OkStatus();
}

}  // namespace

Status WriteDurably(const std::filesystem::path& path, std::string_view content) {
  std::string bytes(kMagic);
  AppendLittleEndian(content.size(), 8, &bytes);
  AppendLittleEndian(Crc32c(content), 4, &bytes);
  bytes.append(content);
  const std::filesystem::path temporary = path.string() + ".tmp";
  const Status written = WriteAndFlush(temporary, bytes);
  if (!written.ok()) {
    ::unlink(temporary.c_str());
    return written;
  }
  if (::rename(temporary.c_str(), path.c_str()) != 0)
    return SystemError("cannot rename", temporary);
  return FlushFolder(path.parent_path());
}

StatusOr<std::string> ReadDurable(const std::filesystem::path& path) {
  std::error_code error;
  if (!std::filesystem::exists(path, error)) {
    return absl::NotFoundError(absl::StrCat("no file ", path.string()));
  }
  std::ifstream file(path, std::ios::binary);
  std::string bytes((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  if (!file) return absl::UnavailableError(absl::StrCat("cannot read ", path.string()));
  const auto damaged = [&](const char* why) {
    return absl::DataLossError(absl::StrCat(path.string(), " is damaged: ", why));
  };
  if (bytes.size() < kHeaderBytes || std::string_view(bytes).substr(0, 8) != kMagic) {
    return damaged("no header");
  }
  const uint64_t length = LittleEndianAt(bytes, 8, 8);
  const auto crc = static_cast<uint32_t>(LittleEndianAt(bytes, 16, 4));
  bytes.erase(0, kHeaderBytes);
  if (bytes.size() != length) return damaged("wrong length");
  if (Crc32c(bytes) != crc) return damaged("wrong checksum");
  return bytes;
}

}  // namespace portolan
