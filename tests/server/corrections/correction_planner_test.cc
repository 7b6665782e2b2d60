#include "server/corrections/correction_planner.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>

#include "tests/server/support/fake_map_engine.h"
#include "tests/server/support/test_submaps.h"

namespace portolan {
namespace {

using ::testing::ElementsAre;

// One session's submaps that a test moves.
class CorrectionPlannerTest : public ::testing::Test {
 protected:
  CorrectionPlannerTest() { snapshot_.components = {{ComponentId(1), true, false}}; }

  void Add() {
    const auto number = static_cast<uint32_t>(states_.size());
    const SubmapInput input{SubmapId(number + 1),
                            std::make_shared<const Submap>(
                                testing::MakeTestSubmap({AgentId("a"), SessionId(1), number})),
                            nullptr};
    states_.push_back(testing::MakeFakeState(input, 20, ++snapshot_.version));
  }
  void Move(size_t number, double distance) {
    auto moved = std::make_shared<SubmapState>(*states_[number]);
    moved->moved_at_version = ++snapshot_.version;
    moved->world_from_submap.translation.z() += distance;
    for (Rigid3& pose : moved->world_from_camera) pose.translation.z() += distance;
    states_[number] = std::move(moved);
  }
  // The sequence numbers that are told.
  std::vector<uint32_t> Next(double time_s, bool all = false) {
    last_ = planner_.Next(states_, snapshot_, FromSeconds(time_s), all);
    std::vector<uint32_t> numbers;
    if (!last_) return numbers;
    for (const SubmapPlacement& placement : last_->submaps) {
      numbers.push_back(placement.sequence_number);
    }
    return numbers;
  }

  CorrectionOptions options_;
  CorrectionPlanner planner_{options_};
  CorrectionPlanner::States states_;
  MapSnapshot snapshot_;
  std::optional<MapCorrection> last_;
};

TEST_F(CorrectionPlannerTest, NewSubmapsAreToldOnceWithTheirKeyframes) {
  Add();
  EXPECT_THAT(Next(0), ElementsAre(0));
  EXPECT_EQ(last_->map_version, 1u);
  EXPECT_FALSE(last_->more);
  EXPECT_TRUE(last_->submaps[0].metric);
  EXPECT_EQ(last_->submaps[0].component, ComponentId(1));
  const SubmapState& state = *states_[0];
  for (size_t i = 0; i < 2; ++i) {
    const Rigid3 world_from_camera =
        last_->submaps[0].world_from_submap * last_->submaps[0].adjusted_submap_from_camera[i];
    EXPECT_TRUE(world_from_camera.Matrix().isApprox(state.world_from_camera[i].Matrix(), 1e-12));
  }
  EXPECT_THAT(Next(1), ElementsAre());
}

TEST_F(CorrectionPlannerTest, OnlyMovementsBeyondTheThresholdAreTold) {
  Add();
  Add();
  Next(0);
  // Median landmark distance is some 5 units, 10 in the world: the threshold is 0.01.
  Move(0, 0.001);
  EXPECT_THAT(Next(1), ElementsAre());
  Move(0, 0.5);
  EXPECT_THAT(Next(2), ElementsAre(0));
  EXPECT_THAT(Next(3), ElementsAre());
}

TEST_F(CorrectionPlannerTest, SmallMovementsAddUp) {
  Add();
  Next(0);
  std::vector<uint32_t> told;
  for (int i = 1; i <= 20 && told.empty(); ++i) {
    Move(0, 0.002);
    told = Next(i);
  }
  EXPECT_THAT(told, ElementsAre(0));
}

TEST_F(CorrectionPlannerTest, AllTellsEveryDifferenceOnce) {
  Add();
  Add();
  Next(0);
  Move(0, 1e-6);
  EXPECT_THAT(Next(1), ElementsAre());
  EXPECT_THAT(Next(1, /*all=*/true), ElementsAre(0));
  EXPECT_THAT(Next(1, /*all=*/true), ElementsAre());
}

TEST_F(CorrectionPlannerTest, BudgetDefersAllButTheNewestNewOne) {
  for (int i = 0; i < 100; ++i) Add();
  const std::vector<uint32_t> first = Next(0);
  ASSERT_LT(first.size(), 100u);
  EXPECT_EQ(first.back(), 99u) << "the newest comes first";
  EXPECT_TRUE(last_->more);
  EXPECT_TRUE(planner_.has_deferred());
  Add();
  EXPECT_THAT(Next(0), ElementsAre(100)) << "a new one is told at once";
  std::set<uint32_t> told(first.begin(), first.end());
  double time = 0;
  while (planner_.has_deferred() && time < 100) {
    for (const uint32_t number : Next(time += 0.5)) told.insert(number);
  }
  EXPECT_FALSE(last_->more);
  EXPECT_EQ(told.size(), 100u);
  const double bytes = 101 * EstimateBytes(last_->submaps[0]);
  EXPECT_GE(time, (bytes - options_.burst_bytes) / options_.bytes_per_second - 1);
}

TEST_F(CorrectionPlannerTest, LongRunStaysWithinTheDownlinkTarget) {
  double bytes = 0;
  double time = 0;
  for (int i = 0; i < 300; ++i) {  // a submap and a movement of all of them every two seconds
    Add();
    for (size_t k = 0; k < states_.size(); ++k) Move(k, 0.1);
    Next(time += 2);
    if (!last_) continue;
    for (const SubmapPlacement& placement : last_->submaps) bytes += EstimateBytes(placement);
  }
  EXPECT_LT(bytes / time, 2000);
}

TEST_F(CorrectionPlannerTest, ResumeTellsWhatMovedSinceTheReceivedVersion) {
  Add();
  Add();
  Add();
  Move(0, 1);                                      // version 4
  planner_.Resume(3, states_, snapshot_.version);  // a server that was restarted
  EXPECT_THAT(Next(0), ElementsAre(0));
}

TEST_F(CorrectionPlannerTest, ResumeRepeatsWhatWasSentButNotReceived) {
  Add();
  Next(0);
  Add();
  Next(1);
  planner_.Resume(1, states_, snapshot_.version);
  EXPECT_THAT(Next(2), ElementsAre(1));
  planner_.Resume(0, states_, snapshot_.version);
  EXPECT_THAT(Next(3), ElementsAre(0, 1));
}

TEST_F(CorrectionPlannerTest, VersionFromAnotherLifeOfTheMapCountsAsNone) {
  Add();
  planner_.Resume(1000, states_, snapshot_.version);
  EXPECT_THAT(Next(0), ElementsAre(0));
}

TEST(CorrectionOptionsTest, RejectsNonsense) {
  CorrectionOptions options;
  EXPECT_TRUE(options.Validate().ok());
  options.bytes_per_second = 0;
  EXPECT_FALSE(options.Validate().ok());
}

}  // namespace
}  // namespace portolan
