// A MapStore in memory whose writes a test can hold up or let fail.
#ifndef PORTOLAN_TESTS_SERVER_SUPPORT_MEMORY_MAP_STORE_H_
#define PORTOLAN_TESTS_SERVER_SUPPORT_MEMORY_MAP_STORE_H_

#include <condition_variable>
#include <mutex>
#include <vector>

#include "server/store/map_store.h"

namespace portolan::testing {

class MemoryMapStore : public MapStore {
 public:
  // AppendSubmaps waits while held.
  void Hold();
  void Release();
  // Blocks until an AppendSubmaps is being held.
  void WaitUntilHeld();
  // Every further write fails.
  void Fail();

  // Sizes of the commits so far.
  std::vector<size_t> group_sizes() const;
  std::vector<SubmapKey> keys() const;
  std::shared_ptr<const MapSnapshot> saved() const;
  int save_count() const;

  Status AddSession(const SessionRecord& session) override;
  Status FinishSession(const AgentId& agent, SessionId session) override;
  StatusOr<std::vector<SubmapId>> AppendSubmaps(const std::vector<NewSubmap>& submaps) override;
  Status SaveSnapshot(const MapSnapshot& snapshot) override;
  Status DropDerived() override;
  StatusOr<StoredMap> Load(const SubmapDecoder& decode) override;
  StatusOr<std::vector<SubmapId>> SubmapsInBox(ComponentId component, const Box& box) override;
  Status SaveSurvey(const Survey& survey) override;
  StatusOr<int64_t> SizeBytes() override;

 private:
  Status WriteStatus() const;

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  // Guarded by mutex_.
  std::vector<SessionRecord> sessions_;
  std::vector<NewSubmap> submaps_;
  std::vector<size_t> group_sizes_;
  std::shared_ptr<const MapSnapshot> saved_;
  int save_count_ = 0;
  Survey survey_;
  bool hold_ = false;
  bool is_held_ = false;
  bool fails_ = false;
};

}  // namespace portolan::testing

#endif  // PORTOLAN_TESTS_SERVER_SUPPORT_MEMORY_MAP_STORE_H_
