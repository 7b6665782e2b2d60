#include "common/concurrency/stage_thread.h"

#include <future>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace portolan {
namespace {

using testing::ElementsAre;

TEST(StageThread, WorksInOrderAndWaitsUntilIdle) {
  std::vector<int> done;
  StageThread<int> stage(2, WhenFull::kBlock, [&](int i) { done.push_back(i); });
  stage.Start();
  for (int i = 0; i < 50; ++i) stage.Push(i);
  stage.WaitUntilIdle();
  ASSERT_EQ(done.size(), 50u);
  for (int i = 0; i < 50; ++i) EXPECT_EQ(done[static_cast<size_t>(i)], i);
}

TEST(StageThread, ItemsPushedBeforeStartWait) {
  std::vector<int> done;
  StageThread<int> stage(4, WhenFull::kReject, [&](int i) { done.push_back(i); });
  stage.Push(1);
  stage.Push(2);
  EXPECT_TRUE(done.empty());
  stage.Start();
  stage.WaitUntilIdle();
  EXPECT_THAT(done, ElementsAre(1, 2));
}

TEST(StageThread, DroppedItemsDoNotHoldUpWaitUntilIdle) {
  std::vector<int> done;
  StageThread<int> stage(2, WhenFull::kDropOldest, [&](int i) { done.push_back(i); });
  for (int i = 0; i < 5; ++i) stage.Push(i);
  EXPECT_EQ(stage.dropped(), 3u);
  stage.Start();
  stage.WaitUntilIdle();
  EXPECT_THAT(done, ElementsAre(3, 4));
}

TEST(StageThread, ShutdownFinishesTheItemUnderWayAndForgetsTheRest) {
  std::promise<void> entered;
  std::promise<void> leave;
  std::atomic<int> done{0};
  StageThread<int> stage(4, WhenFull::kReject, [&](int i) {
    if (i == 0) {
      entered.set_value();
      leave.get_future().wait();
    }
    ++done;
  });
  stage.Start();
  stage.Push(0);
  stage.Push(1);
  entered.get_future().wait();
  std::thread shutdown([&] { stage.Shutdown(); });
  stage.WaitUntilIdle();  // returns because of the shutdown
  leave.set_value();
  shutdown.join();
  EXPECT_EQ(done, 1);
  EXPECT_EQ(stage.Push(2), PushResult::kClosed);
}

TEST(StageThread, ShutdownWithoutStartAndTwiceIsHarmless) {
  StageThread<int> stage(1, WhenFull::kReject, [](int) {});
  stage.Push(1);
  stage.Shutdown();
  stage.Shutdown();
  stage.WaitUntilIdle();
  EXPECT_EQ(stage.Push(2), PushResult::kClosed);
}

}  // namespace
}  // namespace portolan
