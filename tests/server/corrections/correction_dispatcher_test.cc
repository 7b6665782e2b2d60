#include "server/corrections/correction_dispatcher.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <condition_variable>
#include <future>

#include "tests/server/corrections/wall_state.h"
#include "tests/server/support/fake_map_engine.h"
#include "tests/server/support/test_submaps.h"

namespace portolan {
namespace {

class FakeSink : public CorrectionSink {
 public:
  bool IsReady() const override { return ready; }
  void Send(const MapCorrection& correction) override {
    const std::lock_guard lock(mutex_);
    corrections_.push_back(correction);
    changed_.notify_all();
  }
  MapCorrection WaitForCorrection(size_t index) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return corrections_.size() > index; });
    return corrections_[index];
  }
  size_t count() {
    const std::lock_guard lock(mutex_);
    return corrections_.size();
  }

  std::atomic<bool> ready = true;

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<MapCorrection> corrections_;
};

class CorrectionDispatcherTest : public ::testing::Test {
 protected:
  CorrectionDispatcherTest() { dispatcher_.Start(); }

  void Publish(const std::string& agent, uint32_t number, const std::string& quarantine = "") {
    auto next = std::make_shared<MapSnapshot>(*hub_.Get());
    ++next->version;
    const SubmapInput input{SubmapId(static_cast<int64_t>(next->submaps.size()) + 1),
                            std::make_shared<const Submap>(
                                testing::MakeTestSubmap({AgentId(agent), SessionId(1), number})),
                            nullptr};
    auto state = testing::MakeFakeState(input, 5, next->version);
    if (!quarantine.empty()) {
      auto refined = std::make_shared<RefinedSubmap>(*state->refined);
      refined->quarantine_reason = quarantine;
      auto quarantined = std::make_shared<SubmapState>(*state);
      quarantined->refined = refined;
      state = quarantined;
    }
    next->submaps.push_back(state);
    hub_.Publish(next);
  }
  uint64_t Flush(const std::string& agent) {
    std::promise<uint64_t> version;
    dispatcher_.Flush({AgentId(agent), SessionId(1)}, [&](uint64_t v) { version.set_value(v); });
    return version.get_future().get();
  }

  SnapshotHub hub_;
  CorrectionDispatcher dispatcher_{CorrectionOptions(), OfferOptions(), &hub_};
};

TEST_F(CorrectionDispatcherTest, EachAgentGetsItsOwnSubmaps) {
  const auto a = std::make_shared<FakeSink>();
  const auto b = std::make_shared<FakeSink>();
  dispatcher_.Connect({AgentId("a"), SessionId(1)}, 0, a);
  dispatcher_.Connect({AgentId("b"), SessionId(1)}, 0, b);
  Publish("a", 0);
  Publish("b", 0);
  EXPECT_EQ(a->WaitForCorrection(0).submaps.size(), 1u);
  EXPECT_EQ(b->WaitForCorrection(0).map_version, 2u);
  EXPECT_EQ(Flush("a"), 2u);
  EXPECT_EQ(a->count(), 1u);
}

// What is offered is OfferPlanner's business.
TEST_F(CorrectionDispatcherTest, OffersGoToThoseWhoAskForThem) {
  const auto asks = std::make_shared<FakeSink>();
  const auto does_not = std::make_shared<FakeSink>();
  dispatcher_.Connect({AgentId("a"), SessionId(1)}, 0, asks, 500);
  dispatcher_.Connect({AgentId("b"), SessionId(1)}, 0, does_not);
  auto map = std::make_shared<MapSnapshot>(*hub_.Get());
  map->version = 1;
  map->submaps = {testing::MakeWallState("a", 1, Rigid3()),
                  testing::MakeWallState("b", 2, Rigid3())};
  hub_.Publish(map);
  size_t landmarks = 0;
  for (size_t i = 0; landmarks == 0; ++i) {
    for (const LandmarkOffer& offer : asks->WaitForCorrection(i).offers) {
      landmarks += offer.landmarks.size();
      EXPECT_EQ(offer.view >> 8, 2u);
    }
  }
  // At the end nothing is offered any more, and nothing is missing.
  Flush("a");
  EXPECT_EQ(Flush("b"), 1u);
  ASSERT_EQ(does_not->count(), 1u);
  EXPECT_TRUE(does_not->WaitForCorrection(0).offers.empty());
}

TEST_F(CorrectionDispatcherTest, SlowAgentGetsTheNewestStateOnce) {
  const auto sink = std::make_shared<FakeSink>();
  sink->ready = false;
  dispatcher_.Connect({AgentId("a"), SessionId(1)}, 0, sink);
  for (uint32_t i = 0; i < 3; ++i) Publish("a", i);
  EXPECT_EQ(sink->count(), 0u);
  sink->ready = true;
  dispatcher_.Wake();
  EXPECT_EQ(sink->WaitForCorrection(0).submaps.size(), 3u);
}

TEST_F(CorrectionDispatcherTest, FlushWaitsForTheSinkAndComesAfterTheCorrections) {
  const auto sink = std::make_shared<FakeSink>();
  sink->ready = false;
  dispatcher_.Connect({AgentId("a"), SessionId(1)}, 0, sink);
  for (uint32_t i = 0; i < 200; ++i) Publish("a", i);
  std::promise<size_t> told;
  dispatcher_.Flush({AgentId("a"), SessionId(1)},
                    [&](uint64_t) { told.set_value(sink->WaitForCorrection(0).submaps.size()); });
  sink->ready = true;
  dispatcher_.Wake();
  EXPECT_EQ(told.get_future().get(), 200u) << "whatever the budget";
}

TEST_F(CorrectionDispatcherTest, QuarantinedSubmapsAreNotTold) {
  const auto sink = std::make_shared<FakeSink>();
  dispatcher_.Connect({AgentId("a"), SessionId(1)}, 0, sink);
  Publish("a", 0, "implausible");
  Publish("a", 1);
  Flush("a");
  EXPECT_EQ(sink->WaitForCorrection(0).submaps[0].sequence_number, 1u);
  EXPECT_EQ(sink->count(), 1u);
}

TEST_F(CorrectionDispatcherTest, SinkThatIsGoneIsSkipped) {
  auto sink = std::make_shared<FakeSink>();
  dispatcher_.Connect({AgentId("a"), SessionId(1)}, 0, sink);
  sink.reset();
  Publish("a", 0);
  const auto again = std::make_shared<FakeSink>();
  dispatcher_.Connect({AgentId("a"), SessionId(1)}, 0, again);
  EXPECT_EQ(again->WaitForCorrection(0).submaps.size(), 1u);
}

}  // namespace
}  // namespace portolan
