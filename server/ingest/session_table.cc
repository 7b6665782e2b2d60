#include "server/ingest/session_table.h"

#include <algorithm>
#include <utility>

namespace portolan {

Status SessionTable::Restore(const StoredMap& map) {
  for (const SessionRecord& session : map.sessions) {
    PORTOLAN_ASSIGN_OR_RETURN(CameraModel camera, CameraModel::Create(session.camera));
    const SessionName name{session.agent, session.session};
    Add(name, std::make_shared<const CameraModel>(std::move(camera)));
    if (session.finished) SetFinished(name);
  }
  for (const StoredSubmap& submap : map.submaps) {
    AddCommitted(submap.submap->key, submap.id, submap.byte_count);
  }
  return absl::OkStatus();
}

void SessionTable::Add(const SessionName& name, std::shared_ptr<const CameraModel> camera) {
  const std::lock_guard lock(mutex_);
  const auto [entry, is_new] = sessions_.try_emplace(name);
  if (!is_new) return;
  entry->second.creation = sessions_.size();
  entry->second.status.name = name;
  entry->second.status.camera = std::move(camera);
}

std::optional<SessionStatus> SessionTable::Find(const SessionName& name) const {
  const std::lock_guard lock(mutex_);
  const auto entry = sessions_.find(name);
  if (entry == sessions_.end()) return std::nullopt;
  return entry->second.status;
}

std::vector<SessionStatus> SessionTable::List() const {
  std::vector<std::pair<uint64_t, SessionStatus>> found;
  {
    const std::lock_guard lock(mutex_);
    for (const auto& [name, entry] : sessions_) found.emplace_back(entry.creation, entry.status);
  }
  std::sort(found.begin(), found.end(), [](const auto& a, const auto& b) {
    return std::tie(a.second.name.agent, a.first) < std::tie(b.second.name.agent, b.first);
  });
  std::vector<SessionStatus> sessions;
  for (auto& [creation, status] : found) sessions.push_back(std::move(status));
  return sessions;
}

bool SessionTable::IsCommitted(const SubmapKey& key) const {
  const std::lock_guard lock(mutex_);
  const auto entry = sessions_.find({key.agent, key.session});
  return entry != sessions_.end() && entry->second.committed.contains(key.sequence_number);
}

void SessionTable::AddCommitted(const SubmapKey& key, SubmapId id, int64_t byte_count) {
  const std::lock_guard lock(mutex_);
  Entry& entry = sessions_[{key.agent, key.session}];
  entry.committed.insert(key.sequence_number);
  entry.status.submap_count = static_cast<uint32_t>(entry.committed.size());
  entry.status.next_sequence_number =
      std::max(entry.status.next_sequence_number, key.sequence_number + 1);
  byte_counts_[id] = byte_count;
}

void SessionTable::AddRejected(const SubmapKey& key) {
  const std::lock_guard lock(mutex_);
  const auto entry = sessions_.find({key.agent, key.session});
  if (entry == sessions_.end()) return;
  SessionStatus& status = entry->second.status;
  status.next_sequence_number = std::max(status.next_sequence_number, key.sequence_number + 1);
}

void SessionTable::SetFinished(const SessionName& name) {
  const std::lock_guard lock(mutex_);
  sessions_[name].status.finished = true;
}

void SessionTable::SetConnected(const SessionName& name, bool connected) {
  const std::lock_guard lock(mutex_);
  SessionStatus& status = sessions_[name].status;
  status.connected = connected;
  if (!connected) status.live_pose.reset();
}

void SessionTable::SetLivePose(const SessionName& name, const LivePose& pose) {
  const std::lock_guard lock(mutex_);
  SessionStatus& status = sessions_[name].status;
  if (status.connected) status.live_pose = pose;
}

int64_t SessionTable::ByteCount(SubmapId id) const {
  const std::lock_guard lock(mutex_);
  const auto found = byte_counts_.find(id);
  return found == byte_counts_.end() ? 0 : found->second;
}

}  // namespace portolan
