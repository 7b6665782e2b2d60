// A map engine without mathematics: puts submap n at x = 10 n with a few landmarks around it, and
// tells a test what it was asked to do.
#ifndef PORTOLAN_TESTS_SERVER_SUPPORT_FAKE_MAP_ENGINE_H_
#define PORTOLAN_TESTS_SERVER_SUPPORT_FAKE_MAP_ENGINE_H_

#include <condition_variable>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "server/pipeline/map_engine.h"

namespace portolan::testing {

// Shared between the engine, on the map thread, and the test. Thread-safe.
class EngineProbe {
 public:
  // Integration waits while held.
  void Hold();
  void Release();
  // Background work and settling end by themselves; otherwise they go on until interrupted.
  void SetBackgroundEndless(bool endless);
  // "integrate agent/number", "background" and "settle" in order.
  std::vector<std::string> events() const;
  void WaitForEvent(const std::string& event);
  // Until so many submaps' preparation has begun.
  void WaitForPreparations(int count);
  // Until somebody has asked and heard that the map is unsettled.
  void WaitUntilUnsettledIsKnown();

 private:
  friend class FakeMapEngine;
  void Add(const std::string& event);
  void CountPreparation();
  void NoteUnsettled();
  void WaitWhileHeld();
  bool background_endless() const;

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<std::string> events_;
  int preparations_ = 0;
  bool hold_ = false;
  bool background_endless_ = false;
  bool is_unsettled_known_ = false;
};

struct FakeMapEngineOptions {
  int landmarks_per_submap = 5;
  // Each integration leaves one piece of background work.
  bool has_background_work = false;
  // Each integration leaves the map unsettled.
  bool settles = false;
  // Each piece of background work moves all submaps by this much in y.
  double background_shift = 0;
};

class FakeMapEngine : public MapEngine {
 public:
  FakeMapEngine(const FakeMapEngineOptions& options, std::shared_ptr<EngineProbe> probe);

  void Restore(std::shared_ptr<const MapSnapshot> snapshot) override;
  std::shared_ptr<const PreparedSubmap> Prepare(const SubmapInput& input) override;
  void IntegrateSubmap(const SubmapInput& input) override;
  bool HasBackgroundWork() const override { return has_background_work_; }
  void RunBackgroundWork(const std::atomic<bool>& interrupt) override;
  bool HasUnsettled() const override;
  void Settle(const std::atomic<bool>& interrupt) override;
  std::shared_ptr<const MapSnapshot> snapshot() const override { return snapshot_; }
  StageTimes stage_times() const override { return {}; }

 private:
  // While work is endless. False: interrupted.
  bool AwaitEnd(const std::atomic<bool>& interrupt) const;

  const FakeMapEngineOptions options_;
  const std::shared_ptr<EngineProbe> probe_;
  std::shared_ptr<const MapSnapshot> snapshot_;
  bool has_background_work_ = false;
  bool is_unsettled_ = false;
};

// What the engine makes of a submap.
std::shared_ptr<const SubmapState> MakeFakeState(const SubmapInput& input, int landmarks,
                                                 uint64_t version);

}  // namespace portolan::testing

#endif  // PORTOLAN_TESTS_SERVER_SUPPORT_FAKE_MAP_ENGINE_H_
