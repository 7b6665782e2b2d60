#include "tests/server/support/memory_map_store.h"

namespace portolan::testing {

void MemoryMapStore::Hold() {
  const std::lock_guard lock(mutex_);
  hold_ = true;
}

void MemoryMapStore::Release() {
  const std::lock_guard lock(mutex_);
  hold_ = false;
  changed_.notify_all();
}

void MemoryMapStore::WaitUntilHeld() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return is_held_; });
}

void MemoryMapStore::Fail() {
  const std::lock_guard lock(mutex_);
  fails_ = true;
}

std::vector<size_t> MemoryMapStore::group_sizes() const {
  const std::lock_guard lock(mutex_);
  return group_sizes_;
}

std::vector<SubmapKey> MemoryMapStore::keys() const {
  const std::lock_guard lock(mutex_);
  std::vector<SubmapKey> keys;
  for (const NewSubmap& submap : submaps_) keys.push_back(submap.key);
  return keys;
}

std::shared_ptr<const MapSnapshot> MemoryMapStore::saved() const {
  const std::lock_guard lock(mutex_);
  return saved_;
}

int MemoryMapStore::save_count() const {
  const std::lock_guard lock(mutex_);
  return save_count_;
}

Status MemoryMapStore::WriteStatus() const {
  return fails_ ? absl::InternalError("injected") : absl::OkStatus();
}

Status MemoryMapStore::AddSession(const SessionRecord& session) {
  const std::lock_guard lock(mutex_);
  for (const SessionRecord& known : sessions_) {
    if (known.agent != session.agent || known.session != session.session) continue;
    if (known.camera == session.camera) return absl::OkStatus();
    return absl::FailedPreconditionError("another camera");
  }
  sessions_.push_back(session);
  return WriteStatus();
}

Status MemoryMapStore::FinishSession(const AgentId& agent, SessionId session) {
  const std::lock_guard lock(mutex_);
  for (SessionRecord& known : sessions_) {
    if (known.agent == agent && known.session == session) known.finished = true;
  }
  return WriteStatus();
}

StatusOr<std::vector<SubmapId>> MemoryMapStore::AppendSubmaps(
    const std::vector<NewSubmap>& submaps) {
  std::unique_lock lock(mutex_);
  if (hold_) {
    is_held_ = true;
    changed_.notify_all();
    changed_.wait(lock, [&] { return !hold_; });
    is_held_ = false;
  }
  PORTOLAN_RETURN_IF_ERROR(WriteStatus());
  std::vector<SubmapId> ids;
  for (const NewSubmap& submap : submaps) {
    submaps_.push_back(submap);
    ids.emplace_back(static_cast<int64_t>(submaps_.size()));
  }
  group_sizes_.push_back(submaps.size());
  return ids;
}

Status MemoryMapStore::SaveSnapshot(const MapSnapshot& snapshot) {
  const std::lock_guard lock(mutex_);
  ++save_count_;
  PORTOLAN_RETURN_IF_ERROR(WriteStatus());
  saved_ = std::make_shared<const MapSnapshot>(snapshot);
  return absl::OkStatus();
}

Status MemoryMapStore::DropDerived() {
  const std::lock_guard lock(mutex_);
  saved_.reset();
  return WriteStatus();
}

StatusOr<StoredMap> MemoryMapStore::Load(const SubmapDecoder& decode) {
  const std::lock_guard lock(mutex_);
  StoredMap map;
  map.sessions = sessions_;
  map.snapshot = saved_;
  map.survey = survey_;
  for (size_t i = 0; i < submaps_.size(); ++i) {
    PORTOLAN_ASSIGN_OR_RETURN(Submap submap, decode(submaps_[i].bytes));
    PORTOLAN_ASSIGN_OR_RETURN(CameraModel camera, CameraModel::Create(sessions_[0].camera));
    map.submaps.push_back({SubmapId(static_cast<int64_t>(i) + 1),
                           std::make_shared<const Submap>(std::move(submap)),
                           std::make_shared<const CameraModel>(std::move(camera)),
                           static_cast<int64_t>(submaps_[i].bytes.size())});
  }
  return map;
}

StatusOr<std::vector<SubmapId>> MemoryMapStore::SubmapsInBox(ComponentId, const Box&) {
  return absl::UnimplementedError("not needed");
}

Status MemoryMapStore::SaveSurvey(const Survey& survey) {
  const std::lock_guard lock(mutex_);
  PORTOLAN_RETURN_IF_ERROR(WriteStatus());
  survey_ = survey;
  return absl::OkStatus();
}

StatusOr<int64_t> MemoryMapStore::SizeBytes() { return 0; }

}  // namespace portolan::testing
