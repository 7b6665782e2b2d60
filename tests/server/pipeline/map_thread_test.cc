#include "server/pipeline/map_thread.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <condition_variable>
#include <future>
#include <mutex>
#include <thread>

#include "tests/server/support/fake_map_engine.h"
#include "tests/server/support/memory_map_store.h"
#include "tests/server/support/test_submaps.h"

namespace portolan {
namespace {

using ::testing::Contains;
using ::testing::ElementsAre;
using testing::EngineProbe;
using testing::FakeMapEngine;
using testing::FakeMapEngineOptions;
using ::testing::IsSupersetOf;
using ::testing::Not;
using ::testing::SizeIs;

SubmapInput MakeInput(uint32_t number) {
  const SubmapKey key{AgentId("a"), SessionId(1), number};
  return {SubmapId(number + 1), std::make_shared<const Submap>(testing::MakeTestSubmap(key)),
          std::make_shared<const CameraModel>(*CameraModel::Create(testing::TestCamera()))};
}

class MapThreadTest : public ::testing::Test {
 protected:
  void Start(const MapThreadOptions& options, const FakeMapEngineOptions& engine_options = {},
             std::vector<SubmapInput> backlog = {}) {
    thread_ = std::make_unique<MapThread>(
        options, std::make_unique<FakeMapEngine>(engine_options, probe_), &store_, &hub_);
    thread_->Start(std::move(backlog));
  }
  // One submap is integrated, and background work runs that does not end by itself.
  void StartInBackgroundWork(Duration patience) {
    MapThreadOptions options;
    options.background_patience = patience;
    probe_->SetBackgroundEndless(true);
    Start(options, {.has_background_work = true});
    thread_->Push({MakeInput(0)});
    probe_->WaitForEvent("background");
  }
  std::vector<std::string> FirstEvents(size_t count) const {
    std::vector<std::string> events = probe_->events();
    events.resize(std::min(events.size(), count));
    return events;
  }
  uint64_t Settle() {
    std::promise<uint64_t> version;
    thread_->WhenSettled([&](uint64_t v) { version.set_value(v); });
    return version.get_future().get();
  }

  testing::MemoryMapStore store_;
  SnapshotHub hub_;
  const std::shared_ptr<EngineProbe> probe_ = std::make_shared<EngineProbe>();
  std::unique_ptr<MapThread> thread_;
};

TEST_F(MapThreadTest, IntegratesInOrderPublishesAndSaves) {
  Start({});
  thread_->Push({MakeInput(0), MakeInput(1)});
  thread_->Push({MakeInput(2)});
  EXPECT_EQ(Settle(), 3u);
  EXPECT_THAT(probe_->events(), ElementsAre("integrate a/0", "integrate a/1", "integrate a/2"));
  EXPECT_THAT(hub_.Get()->submaps, SizeIs(3));
  ASSERT_NE(store_.saved(), nullptr);
  EXPECT_EQ(store_.saved()->version, 3u) << "saved before settled";
  EXPECT_EQ(thread_->queue_size(), 0);
}

TEST_F(MapThreadTest, BacklogComesFirst) {
  Start({}, {}, {MakeInput(0), MakeInput(1)});
  thread_->Push({MakeInput(2)});
  Settle();
  EXPECT_THAT(probe_->events(), ElementsAre("integrate a/0", "integrate a/1", "integrate a/2"));
}

TEST_F(MapThreadTest, SettledMeansBackgroundWorkIsDone) {
  Start({}, {.has_background_work = true, .background_shift = 1});
  thread_->Push({MakeInput(0)});
  EXPECT_EQ(Settle(), 2u);
  EXPECT_THAT(probe_->events(), ElementsAre("integrate a/0", "background"));
  EXPECT_EQ(hub_.Get()->version, 2u);
}

TEST_F(MapThreadTest, NewSubmapInterruptsBackgroundWork) {
  StartInBackgroundWork(MapThreadOptions().background_patience);
  thread_->Push({MakeInput(1)});
  probe_->WaitForEvent("integrate a/1");
  probe_->SetBackgroundEndless(false);
  Settle();
  EXPECT_THAT(FirstEvents(4),
              ElementsAre("integrate a/0", "background", "interrupted", "integrate a/1"));
}

TEST_F(MapThreadTest, ReadySubmapWaitsForBackgroundWorkThatEndsInTime) {
  StartInBackgroundWork(std::chrono::hours(1));
  thread_->Push({MakeInput(1), MakeInput(2)});
  // When the last one's turn comes the one before it is ready, and was not too late.
  probe_->WaitForPreparations(3);
  EXPECT_THAT(probe_->events(), ElementsAre("integrate a/0", "background"));
  probe_->SetBackgroundEndless(false);
  Settle();
  EXPECT_THAT(probe_->events(), Not(Contains("interrupted")));
  EXPECT_THAT(hub_.Get()->submaps, SizeIs(3));
}

TEST_F(MapThreadTest, ReadySubmapInterruptsBackgroundWorkAfterItsPatience) {
  constexpr std::chrono::milliseconds kPatience(300);
  StartInBackgroundWork(kPatience);
  const auto pushed = std::chrono::steady_clock::now();
  // Those that come meanwhile do not make the oldest wait longer.
  std::promise<void> enough;
  std::thread others([&, stop = enough.get_future()] {
    uint32_t number = 1;
    do {
      thread_->Push({MakeInput(number)});
    } while (++number < 200 &&
             stop.wait_for(std::chrono::milliseconds(50)) == std::future_status::timeout);
  });
  probe_->WaitForEvent("integrate a/1");
  const auto waited = std::chrono::steady_clock::now() - pushed;
  enough.set_value();
  others.join();
  probe_->SetBackgroundEndless(false);
  Settle();
  EXPECT_GE(waited, kPatience);
  EXPECT_LT(waited, std::chrono::seconds(5));
  EXPECT_EQ(probe_->events()[2], "interrupted");
}

// All that is prepared ahead is ready, and one more waits: for the map thread alone.
TEST_F(MapThreadTest, BackgroundWorkIsInterruptedWhenTooManyWait) {
  StartInBackgroundWork(std::chrono::hours(1));
  for (uint32_t number = 1; number <= 8; ++number) thread_->Push({MakeInput(number)});
  probe_->WaitForPreparations(9);
  EXPECT_THAT(probe_->events(), ElementsAre("integrate a/0", "background"));
  thread_->Push({MakeInput(9)});
  probe_->WaitForEvent("integrate a/1");
  probe_->SetBackgroundEndless(false);
  Settle();
  EXPECT_EQ(probe_->events()[2], "interrupted");
  EXPECT_THAT(hub_.Get()->submaps, SizeIs(10));
}

TEST_F(MapThreadTest, WithoutPatienceASubmapInterruptsAtOnceAndOftenEnough) {
  MapThreadOptions options;
  options.background_patience = {};
  probe_->SetBackgroundEndless(true);
  Start(options, {.has_background_work = true});
  for (uint32_t number = 0; number < 50; ++number) {
    thread_->Push({MakeInput(number)});
    probe_->WaitForEvent("integrate a/" + std::to_string(number));
  }
  probe_->SetBackgroundEndless(false);
  Settle();
  EXPECT_THAT(hub_.Get()->submaps, SizeIs(50));
}

TEST_F(MapThreadTest, LockstepIgnoresTheClock) {
  MapThreadOptions options;
  options.background_patience = {};
  options.lockstep = true;
  probe_->SetBackgroundEndless(true);
  Start(options, {.has_background_work = true});
  thread_->Push({MakeInput(0), MakeInput(1), MakeInput(2)});
  probe_->WaitForEvent("background");
  probe_->WaitForPreparations(3);
  EXPECT_THAT(probe_->events(), ElementsAre("integrate a/0", "background"));
  probe_->SetBackgroundEndless(false);
  Settle();
  EXPECT_THAT(hub_.Get()->submaps, SizeIs(3));
}

TEST_F(MapThreadTest, LockstepCompletesBackgroundWorkAfterEverySubmap) {
  MapThreadOptions options;
  options.lockstep = true;
  probe_->Hold();
  Start(options, {.has_background_work = true});
  thread_->Push({MakeInput(0), MakeInput(1)});
  probe_->Release();
  Settle();
  EXPECT_THAT(probe_->events(),
              ElementsAre("integrate a/0", "background", "integrate a/1", "background"));
  EXPECT_EQ(store_.save_count(), 2) << "saved after every submap";
}

TEST_F(MapThreadTest, SettlesWhenSomeoneAsks) {
  for (const bool lockstep : {false, true}) {
    MapThreadOptions options;
    options.settling_patience = std::chrono::hours(1);
    options.lockstep = lockstep;
    Start(options, {.has_background_work = true, .settles = true});
    thread_->Push({MakeInput(0)});
    probe_->WaitForEvent("background");
    Settle();
    std::vector<std::string> events = probe_->events();
    ASSERT_GE(events.size(), 3u);
    EXPECT_THAT(std::vector<std::string>(events.end() - 3, events.end()),
                ElementsAre("integrate a/0", "background", "settle"));
    thread_->Shutdown();
    thread_.reset();
  }
}

TEST_F(MapThreadTest, SettlesOnceNothingComes) {
  MapThreadOptions options;
  options.settling_patience = std::chrono::milliseconds(20);
  Start(options, {.has_background_work = true, .settles = true});
  thread_->Push({MakeInput(0)});
  probe_->WaitForEvent("settle");
  EXPECT_THAT(probe_->events(), ElementsAre("integrate a/0", "background", "settle"));
}

TEST_F(MapThreadTest, NewSubmapInterruptsSettling) {
  MapThreadOptions options;
  options.settling_patience = Duration::zero();
  Start(options, {.settles = true});
  probe_->SetBackgroundEndless(true);
  thread_->Push({MakeInput(0)});
  probe_->WaitForEvent("settle");
  thread_->Push({MakeInput(1)});
  probe_->WaitForEvent("integrate a/1");
  probe_->SetBackgroundEndless(false);
  Settle();
  EXPECT_THAT(FirstEvents(4),
              ElementsAre("integrate a/0", "settle", "interrupted", "integrate a/1"));
  EXPECT_EQ(probe_->events().back(), "settle");
}

TEST_F(MapThreadTest, InLockstepTheMapDoesNotSettleByItself) {
  MapThreadOptions options;
  options.settling_patience = Duration::zero();
  options.lockstep = true;
  Start(options, {.settles = true});
  thread_->Push({MakeInput(0)});
  // The map thread has nothing else to do.
  probe_->WaitUntilUnsettledIsKnown();
  thread_->Push({MakeInput(1)});
  probe_->WaitForEvent("integrate a/1");
  EXPECT_THAT(probe_->events(), ElementsAre("integrate a/0", "integrate a/1"));
}

TEST_F(MapThreadTest, FullQueueBlocksPushUntilThereIsRoom) {
  MapThreadOptions options;
  options.max_queue = 2;
  probe_->Hold();
  Start(options);
  // One is taken off the queue and held, two wait, the fourth blocks.
  std::future<void> push = std::async(std::launch::async, [&] {
    thread_->Push({MakeInput(0), MakeInput(1), MakeInput(2), MakeInput(3), MakeInput(4)});
  });
  EXPECT_EQ(push.wait_for(std::chrono::milliseconds(50)), std::future_status::timeout);
  EXPECT_LE(thread_->queue_size(), 3);
  probe_->Release();
  push.get();
  Settle();
  EXPECT_THAT(hub_.Get()->submaps, SizeIs(5));
}

TEST_F(MapThreadTest, ShutdownReleasesPushAndSaves) {
  MapThreadOptions options;
  options.max_queue = 1;
  options.save_interval = std::chrono::hours(1);
  Start(options);
  thread_->Push({MakeInput(0)});
  probe_->WaitForEvent("integrate a/0");
  probe_->Hold();
  std::future<void> push = std::async(std::launch::async, [&] {
    thread_->Push({MakeInput(1), MakeInput(2), MakeInput(3)});
  });
  std::future<void> shutdown = std::async(std::launch::async, [&] { thread_->Shutdown(); });
  push.get();
  probe_->Release();
  shutdown.get();
  ASSERT_NE(store_.saved(), nullptr);
  EXPECT_EQ(store_.saved()->version, hub_.Get()->version);
}

TEST_F(MapThreadTest, FailedSaveIsReportedAndTheMapGoesOn) {
  Start({});
  store_.Fail();
  thread_->Push({MakeInput(0)});
  Settle();
  EXPECT_FALSE(thread_->save_status().ok());
  thread_->Push({MakeInput(1)});
  EXPECT_EQ(Settle(), 2u);
}

// Prepares nothing before seven submaps are refined.
class RefiningEngine : public FakeMapEngine {
 public:
  explicit RefiningEngine(std::shared_ptr<EngineProbe> probe) : FakeMapEngine({}, probe) {}

  std::shared_ptr<const RefinedSubmap> Refine(const SubmapInput& input) override {
    auto refined = std::make_shared<RefinedSubmap>();
    refined->id = input.id;
    const std::lock_guard lock(mutex_);
    ++refined_;
    changed_.notify_all();
    return refined;
  }
  std::shared_ptr<const PreparedSubmap> Prepare(const SubmapInput& input) override {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return refined_ >= 7; });
    if (input.refined != nullptr) prepared_from_refined_.push_back(input.refined->id);
    return nullptr;
  }
  std::vector<SubmapId> prepared_from_refined() const {
    const std::lock_guard lock(mutex_);
    return prepared_from_refined_;
  }

 private:
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  int refined_ = 0;
  std::vector<SubmapId> prepared_from_refined_;
};

TEST_F(MapThreadTest, RefinesAheadWhenPreparationIsBehind) {
  auto engine = std::make_unique<RefiningEngine>(probe_);
  const RefiningEngine& refining = *engine;
  thread_ = std::make_unique<MapThread>(MapThreadOptions(), std::move(engine), &store_, &hub_);
  thread_->Start({});
  std::vector<SubmapInput> submaps;
  for (uint32_t i = 0; i < 12; ++i) submaps.push_back(MakeInput(i));
  thread_->Push(std::move(submaps));
  Settle();
  EXPECT_THAT(refining.prepared_from_refined(), IsSupersetOf({SubmapId(3), SubmapId(4)}));
  EXPECT_THAT(probe_->events(), SizeIs(12));
  EXPECT_THAT(hub_.Get()->submaps, SizeIs(12));
  for (size_t i = 0; i < 12; ++i) {
    EXPECT_EQ(probe_->events()[i], "integrate a/" + std::to_string(i));
  }
}

TEST(SnapshotHubTest, TellsSubscribersUntilTheyLeave) {
  SnapshotHub hub;
  ASSERT_NE(hub.Get(), nullptr);
  EXPECT_EQ(hub.Get()->version, 0u);
  int calls = 0;
  const uint64_t subscription = hub.Subscribe([&] { ++calls; });
  auto snapshot = std::make_shared<MapSnapshot>();
  snapshot->version = 5;
  hub.Publish(snapshot);
  EXPECT_EQ(hub.Get()->version, 5u);
  EXPECT_EQ(calls, 1);
  hub.Unsubscribe(subscription);
  hub.Publish(snapshot);
  EXPECT_EQ(calls, 1);
}

}  // namespace
}  // namespace portolan
