// The submaps of one session that the server has not acknowledged yet, on disk.
#ifndef PORTOLAN_AGENT_UPLINK_OUTBOX_H_
#define PORTOLAN_AGENT_UPLINK_OUTBOX_H_

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "common/base/status.h"
#include "common/wire/agent_wire.h"

namespace portolan {

struct OutboxOptions {
  // Of pending submaps. When a new one would exceed it, the new one is refused and what is on disk
  // stays: the older submaps are the ones that link to what the server already has. 1 GiB is about
  // a day of driving without network.
  uint64_t max_bytes = uint64_t{1} << 30;

  Status Validate() const;
};

// A random session id, never 0.
SessionId DrawSessionId();

// A folder, `root`/<session id in hex>, with
//   session          who and which camera (serialised portolan.v1.Hello), written once
//   lock             held (flock) by the process that uses it
//   NNNNNNNNNN.submap           pending, one file each (EncodeSubmap), see durable_file.h
//   NNNNNNNNNN.submap.corrupt   damaged on disk, set aside
//   NNNNNNNNNN.submap.rejected  refused by the server, the reason in ....rejected.txt
// A submap is on disk for good when Append returns OK. Thread-safe.
class Outbox {
 public:
  // A new session. AlreadyExists if the session has a folder.
  static StatusOr<std::unique_ptr<Outbox>> Create(const std::filesystem::path& root,
                                                  const SessionHello& hello,
                                                  const OutboxOptions& options);
  // A session left by an earlier process. Unavailable while another process has it open, DataLoss
  // if its `session` file is damaged.
  static StatusOr<std::unique_ptr<Outbox>> Open(const std::filesystem::path& folder,
                                                const OutboxOptions& options);
  // Folders of sessions that still have pending submaps, oldest first. Open may refuse some.
  static std::vector<std::filesystem::path> FindPendingSessions(const std::filesystem::path& root);
  // Deletes the folders of sessions that have nothing pending or set aside and are not in use.
  static void RemoveDoneSessions(const std::filesystem::path& root);
  ~Outbox();
  Outbox(const Outbox&) = delete;
  Outbox& operator=(const Outbox&) = delete;

  const SessionHello& hello() const { return hello_; }
  const std::filesystem::path& folder() const { return folder_; }

  // ResourceExhausted if the limit or the disk is full, AlreadyExists for a number that does not
  // ascend.
  Status Append(uint32_t sequence_number, std::string_view submap_bytes);

  // The lowest pending sequence number that is at least `from`.
  std::optional<uint32_t> NextPending(uint32_t from) const;
  bool IsPending(uint32_t sequence_number) const;
  size_t pending_count() const;
  uint64_t pending_bytes() const;
  // 1 + the highest sequence number ever seen here, 0 if none.
  uint32_t next_sequence_number() const;

  // A pending submap. If its file is damaged or gone it is set aside, no longer pending, and the
  // answer is DataLoss.
  StatusOr<std::string> Read(uint32_t sequence_number);

  // The server has it. Unknown numbers are ignored.
  void Remove(uint32_t sequence_number);
  void RemoveBelow(uint32_t sequence_number);
  // The server refused it; kept beside the pending ones for the operator.
  void SetAsideRejected(uint32_t sequence_number, const std::string& reason);

  // Deletes the folder if nothing is pending or set aside. Nothing may be appended afterwards.
  void RemoveIfDone();

 private:
  Outbox(std::filesystem::path folder, SessionHello hello, const OutboxOptions& options, int lock);

  std::filesystem::path FileOf(uint32_t sequence_number) const;
  void ScanFolder();
  // Takes the number off the list; false if it was not on it.
  bool Forget(uint32_t sequence_number);

  const std::filesystem::path folder_;
  const SessionHello hello_;
  const OutboxOptions options_;
  const int lock_;
  mutable std::mutex mutex_;
  std::map<uint32_t, uint64_t> pending_bytes_of_ ABSL_GUARDED_BY(mutex_);
  uint64_t pending_bytes_ ABSL_GUARDED_BY(mutex_) = 0;
  uint32_t next_sequence_number_ ABSL_GUARDED_BY(mutex_) = 0;
  bool removed_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_UPLINK_OUTBOX_H_
