#include "agent/uplink/outbox.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <fstream>
#include <random>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "agent/uplink/durable_file.h"
#include "common/wire/submap_validation.h"

namespace portolan {
namespace {

namespace fs = std::filesystem;

constexpr char kSubmapSuffix[] = ".submap";
constexpr int kNumberDigits = 10;

// NNNNNNNNNN.submap -> number.
std::optional<uint32_t> NumberOf(const std::string& name) {
  if (name.size() != kNumberDigits + sizeof(kSubmapSuffix) - 1 ||
      name.substr(kNumberDigits) != kSubmapSuffix) {
    return std::nullopt;
  }
  uint32_t number = 0;
  if (!absl::SimpleAtoi(name.substr(0, kNumberDigits), &number)) return std::nullopt;
  return number;
}

// Number in the name of any file of a submap, set aside or not.
std::optional<uint32_t> NumberOfAny(const std::string& name) {
  return NumberOf(name.substr(0, kNumberDigits + sizeof(kSubmapSuffix) - 1));
}

std::vector<std::string> NamesIn(const fs::path& folder) {
  std::vector<std::string> names;
  std::error_code error;
  fs::directory_iterator it(folder, error);
  for (; !error && it != fs::directory_iterator(); it.increment(error)) {
    names.push_back(it->path().filename().string());
  }
  std::sort(names.begin(), names.end());
  return names;
}

StatusOr<int> LockFolder(const fs::path& folder) {
  const fs::path path = folder / "lock";
  const int lock = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (lock < 0) return absl::UnavailableError(absl::StrCat("cannot open ", path.string()));
  if (::flock(lock, LOCK_EX | LOCK_NB) != 0) {
    ::close(lock);
    return absl::UnavailableError(
        absl::StrCat("outbox ", folder.string(), " is in use by another process"));
  }
  return lock;
}

std::string HexOf(SessionId session) {
  char text[17];
  std::snprintf(text, sizeof(text), "%016llx", static_cast<unsigned long long>(session.value()));
  return text;
}

void Rename(const fs::path& from, const fs::path& to) {
  std::error_code error;  // if it fails the file is found again at the next start
  fs::rename(from, to, error);
}

}  // namespace

Status OutboxOptions::Validate() const {
  if (max_bytes >= kMaxSubmapBytes) return absl::OkStatus();
  return absl::InvalidArgumentError("outbox.max_bytes: less than one submap (2 MiB)");
}

SessionId DrawSessionId() {
  std::random_device device;
  uint64_t id = 0;
  while (id == 0) id = (static_cast<uint64_t>(device()) << 32) | device();
  return SessionId(id);
}

Outbox::Outbox(fs::path folder, SessionHello hello, const OutboxOptions& options, int lock)
    : folder_(std::move(folder)), hello_(std::move(hello)), options_(options), lock_(lock) {}

Outbox::~Outbox() { ::close(lock_); }

StatusOr<std::unique_ptr<Outbox>> Outbox::Create(const fs::path& root, const SessionHello& hello,
                                                 const OutboxOptions& options) {
  PORTOLAN_RETURN_IF_ERROR(options.Validate());
  PORTOLAN_RETURN_IF_ERROR(ValidateSession(hello.agent, hello.session));
  const fs::path folder = root / HexOf(hello.session);
  std::error_code error;
  fs::create_directories(root, error);
  if (error || (!fs::create_directory(folder, error) && error)) {
    return absl::UnavailableError(
        absl::StrCat("cannot create ", folder.string(), ": ", error.message()));
  }
  if (fs::exists(folder / "session", error)) {
    return absl::AlreadyExistsError(absl::StrCat("session ", folder.string(), " exists"));
  }
  PORTOLAN_ASSIGN_OR_RETURN(const int lock, LockFolder(folder));
  std::unique_ptr<Outbox> outbox(new Outbox(folder, hello, options, lock));
  v1::Hello message;
  ToProto(hello, &message);
  PORTOLAN_RETURN_IF_ERROR(WriteDurably(folder / "session", message.SerializeAsString()));
  return outbox;
}

StatusOr<std::unique_ptr<Outbox>> Outbox::Open(const fs::path& folder,
                                               const OutboxOptions& options) {
  PORTOLAN_RETURN_IF_ERROR(options.Validate());
  PORTOLAN_ASSIGN_OR_RETURN(const std::string bytes, ReadDurable(folder / "session"));
  v1::Hello message;
  if (!message.ParseFromString(bytes)) {
    return absl::DataLossError(absl::StrCat((folder / "session").string(), " is no Hello"));
  }
  PORTOLAN_ASSIGN_OR_RETURN(SessionHello hello, FromProto(message));
  hello.received_map_version = 0;
  PORTOLAN_ASSIGN_OR_RETURN(const int lock, LockFolder(folder));
  std::unique_ptr<Outbox> outbox(new Outbox(folder, std::move(hello), options, lock));
  outbox->ScanFolder();
  return outbox;
}

std::vector<fs::path> Outbox::FindPendingSessions(const fs::path& root) {
  std::vector<std::pair<fs::file_time_type, fs::path>> found;
  for (const std::string& name : NamesIn(root)) {
    const fs::path folder = root / name;
    const auto files = NamesIn(folder);
    const bool pending = std::any_of(files.begin(), files.end(), [](const std::string& file) {
      return NumberOf(file).has_value();
    });
    std::error_code error;
    const auto time = fs::last_write_time(folder / "session", error);
    if (pending && !error) found.emplace_back(time, folder);
  }
  std::sort(found.begin(), found.end());
  std::vector<fs::path> folders;
  for (auto& [time, folder] : found) folders.push_back(std::move(folder));
  return folders;
}

void Outbox::RemoveDoneSessions(const fs::path& root) {
  for (const std::string& name : NamesIn(root)) {
    const auto outbox = Open(root / name, OutboxOptions());
    if (outbox.ok()) (*outbox)->RemoveIfDone();
  }
}

void Outbox::ScanFolder() {
  std::unique_lock lock(mutex_);
  for (const std::string& name : NamesIn(folder_)) {
    const auto any = NumberOfAny(name);
    if (any.has_value()) next_sequence_number_ = std::max(next_sequence_number_, *any + 1);
    std::error_code error;
    if (name.size() > 4 && name.substr(name.size() - 4) == ".tmp") {
      fs::remove(folder_ / name, error);  // a write that a kill cut short
    }
    const auto number = NumberOf(name);
    if (!number.has_value()) continue;
    const auto bytes = fs::file_size(folder_ / name, error);
    pending_bytes_of_[*number] = error ? 0 : bytes;
    pending_bytes_ += error ? 0 : bytes;
  }
}

fs::path Outbox::FileOf(uint32_t sequence_number) const {
  char name[32];
  std::snprintf(name, sizeof(name), "%010u%s", sequence_number, kSubmapSuffix);
  return folder_ / name;
}

Status Outbox::Append(uint32_t sequence_number, std::string_view submap_bytes) {
  {
    std::unique_lock lock(mutex_);
    if (removed_ || sequence_number < next_sequence_number_) {
      return absl::AlreadyExistsError(
          absl::StrCat("submap ", sequence_number, " does not follow in ", folder_.string()));
    }
    next_sequence_number_ = sequence_number + 1;
    if (pending_bytes_ + submap_bytes.size() > options_.max_bytes) {
      return absl::ResourceExhaustedError(absl::StrCat(
          "outbox is full (", pending_bytes_, " bytes); submap ", sequence_number, " is lost"));
    }
  }
  // Without the lock: flushing takes milliseconds. Only the agent's thread appends.
  PORTOLAN_RETURN_IF_ERROR(WriteDurably(FileOf(sequence_number), submap_bytes));
  std::unique_lock lock(mutex_);
  pending_bytes_of_[sequence_number] = submap_bytes.size();
  pending_bytes_ += submap_bytes.size();
  return absl::OkStatus();
}

std::optional<uint32_t> Outbox::NextPending(uint32_t from) const {
  std::unique_lock lock(mutex_);
  const auto at = pending_bytes_of_.lower_bound(from);
  if (at == pending_bytes_of_.end()) return std::nullopt;
  return at->first;
}

bool Outbox::IsPending(uint32_t sequence_number) const {
  std::unique_lock lock(mutex_);
  return pending_bytes_of_.count(sequence_number) > 0;
}

size_t Outbox::pending_count() const {
  std::unique_lock lock(mutex_);
  return pending_bytes_of_.size();
}

uint64_t Outbox::pending_bytes() const {
  std::unique_lock lock(mutex_);
  return pending_bytes_;
}

uint32_t Outbox::next_sequence_number() const {
  std::unique_lock lock(mutex_);
  return next_sequence_number_;
}

StatusOr<std::string> Outbox::Read(uint32_t sequence_number) {
  const fs::path file = FileOf(sequence_number);
  auto bytes = ReadDurable(file);
  if (bytes.ok() || absl::IsUnavailable(bytes.status())) return bytes;
  if (Forget(sequence_number)) Rename(file, file.string() + ".corrupt");
  return absl::DataLossError(bytes.status().message());
}

bool Outbox::Forget(uint32_t sequence_number) {
  std::unique_lock lock(mutex_);
  const auto at = pending_bytes_of_.find(sequence_number);
  if (at == pending_bytes_of_.end()) return false;
  pending_bytes_ -= at->second;
  pending_bytes_of_.erase(at);
  return true;
}

void Outbox::Remove(uint32_t sequence_number) {
  if (!Forget(sequence_number)) return;
  // If the removal does not reach the disk, the submap is sent again, which is harmless.
  std::error_code error;
  fs::remove(FileOf(sequence_number), error);
}

void Outbox::RemoveBelow(uint32_t sequence_number) {
  for (auto next = NextPending(0); next.has_value() && *next < sequence_number;
       next = NextPending(0)) {
    Remove(*next);
  }
}

void Outbox::SetAsideRejected(uint32_t sequence_number, const std::string& reason) {
  if (!Forget(sequence_number)) return;
  const fs::path rejected = FileOf(sequence_number).string() + ".rejected";
  Rename(FileOf(sequence_number), rejected);
  std::ofstream(rejected.string() + ".txt") << reason << "\n";
}

void Outbox::RemoveIfDone() {
  std::unique_lock lock(mutex_);
  for (const std::string& name : NamesIn(folder_)) {
    if (name != "session" && name != "lock") return;
  }
  removed_ = true;
  std::error_code error;
  fs::remove_all(folder_, error);
}

}  // namespace portolan
