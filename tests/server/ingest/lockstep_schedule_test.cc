#include "server/ingest/lockstep_schedule.h"

#include <gtest/gtest.h>

namespace portolan {
namespace {

const AgentId kA("a"), kB("b"), kC("c");

TEST(LockstepSchedule, TurnGoesBySequenceNumberThenByList) {
  LockstepSchedule schedule({kB, kA});
  EXPECT_EQ(schedule.Turn(), kB);
  schedule.Resume(kB, 1);
  EXPECT_EQ(schedule.Turn(), kA);
  schedule.Resume(kA, 3);  // numbers 1 and 2 were lost
  EXPECT_EQ(schedule.Turn(), kB);
  schedule.Resume(kB, 4);
  EXPECT_EQ(schedule.Turn(), kA);
}

TEST(LockstepSchedule, FinishedAgentsAreSkippedUntilTheyResume) {
  LockstepSchedule schedule({kA, kB});
  schedule.Finish(kA);
  EXPECT_EQ(schedule.Turn(), kB);
  schedule.Finish(kB);
  EXPECT_TRUE(schedule.AllFinished());
  schedule.Resume(kA, 0);
  EXPECT_EQ(schedule.Turn(), kA);
}

TEST(LockstepSchedule, UnknownAgentsAreIgnored) {
  LockstepSchedule schedule({kA});
  EXPECT_TRUE(schedule.enabled());
  EXPECT_FALSE(schedule.IsDeclared(kC));
  schedule.Resume(kC, 0);
  schedule.Finish(kC);
  EXPECT_EQ(schedule.Turn(), kA);
  EXPECT_FALSE(LockstepSchedule({}).enabled());
}

}  // namespace
}  // namespace portolan
