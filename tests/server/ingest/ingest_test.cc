#include "server/ingest/ingest.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <future>

#include "tests/server/support/memory_map_store.h"
#include "tests/server/support/test_submaps.h"

namespace portolan {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::MakeTestUpload;
using testing::TestHello;
using testing::TestSession;

class IngestTest : public ::testing::Test {
 protected:
  ~IngestTest() override {
    store_.Release();
    if (ingest_) ingest_->Shutdown();
  }

  void Start(const IngestOptions& options = {}) {
    ingest_ = std::make_unique<Ingest>(
        options, &store_, &sessions_,
        [this](std::vector<SubmapInput> submaps) {
          const std::lock_guard lock(mutex_);
          for (const SubmapInput& submap : submaps) {
            integrated_.push_back(submap.submap->key.agent.value() + "/" +
                                  std::to_string(submap.submap->key.sequence_number));
          }
        },
        [this](const Status&) { store_failures_ += 1; });
    ingest_->Start();
  }
  std::future<StatusOr<IngestVerdict>> Submit(const std::string& agent, uint32_t number) {
    return Submit(agent, MakeTestUpload(agent, number));
  }
  std::future<StatusOr<IngestVerdict>> Submit(const std::string& agent,
                                              const v1::SubmapUpload& upload) {
    auto verdict = std::make_shared<std::promise<StatusOr<IngestVerdict>>>();
    ingest_->Submit(TestSession(agent), upload,
                    [verdict](StatusOr<IngestVerdict> v) { verdict->set_value(std::move(v)); });
    return verdict->get_future();
  }
  std::vector<std::string> integrated() {
    const std::lock_guard lock(mutex_);
    return integrated_;
  }

  testing::MemoryMapStore store_;
  SessionTable sessions_;
  std::mutex mutex_;
  std::vector<std::string> integrated_;
  std::atomic<int> store_failures_ = 0;
  std::unique_ptr<Ingest> ingest_;
};

TEST_F(IngestTest, CommitsThenHandsOnThenAnswers) {
  Start();
  EXPECT_EQ(*ingest_->OpenSession(TestHello("a")), 0u);
  const auto verdict = Submit("a", 0).get();
  ASSERT_TRUE(verdict.ok());
  EXPECT_TRUE(verdict->accepted);
  EXPECT_THAT(store_.keys(), ElementsAre(SubmapKey{AgentId("a"), SessionId(1), 0}));
  EXPECT_THAT(integrated(), ElementsAre("a/0"));
  EXPECT_EQ(*ingest_->OpenSession(TestHello("a")), 1u) << "the session resumes behind it";
}

TEST_F(IngestTest, DuplicateIsAcceptedAgainAndChangesNothing) {
  Start();
  ASSERT_TRUE(ingest_->OpenSession(TestHello("a")).ok());
  EXPECT_TRUE(Submit("a", 0).get()->accepted);
  const auto verdict = Submit("a", 0).get();
  ASSERT_TRUE(verdict.ok());
  EXPECT_TRUE(verdict->accepted);
  EXPECT_THAT(integrated(), ElementsAre("a/0"));
}

TEST_F(IngestTest, MissingNumberIsAcceptedButNeverLater) {
  Start();
  ASSERT_TRUE(ingest_->OpenSession(TestHello("a")).ok());
  EXPECT_TRUE(Submit("a", 0).get()->accepted);
  EXPECT_TRUE(Submit("a", 2).get()->accepted);
  const auto late = Submit("a", 1).get();
  ASSERT_TRUE(late.ok());
  EXPECT_FALSE(late->accepted);
  EXPECT_THAT(late->reason, HasSubstr("later submap"));
  EXPECT_THAT(integrated(), ElementsAre("a/0", "a/2"));
}

TEST_F(IngestTest, DamagedUploadIsRejectedWithAReason) {
  Start();
  ASSERT_TRUE(ingest_->OpenSession(TestHello("a")).ok());
  v1::SubmapUpload damaged = MakeTestUpload("a", 0);
  damaged.mutable_submap()->at(10) ^= 1;
  const auto verdict = Submit("a", damaged).get();
  ASSERT_TRUE(verdict.ok());
  EXPECT_FALSE(verdict->accepted);
  EXPECT_NE(verdict->reason, "");
  EXPECT_THAT(store_.keys(), IsEmpty());
}

TEST_F(IngestTest, SubmapOfAnotherNameIsRejected) {
  Start();
  ASSERT_TRUE(ingest_->OpenSession(TestHello("a")).ok());
  EXPECT_FALSE(Submit("a", MakeTestUpload("b", 0)).get()->accepted);
  v1::SubmapUpload wrong_number = MakeTestUpload("a", 0);
  wrong_number.set_sequence_number(1);
  EXPECT_FALSE(Submit("a", wrong_number).get()->accepted);
  EXPECT_THAT(store_.keys(), IsEmpty());
}

TEST_F(IngestTest, WhatWaitsDuringACommitIsCommittedAtOnce) {
  Start();
  for (const char* agent : {"a", "b", "c", "d"}) {
    ASSERT_TRUE(ingest_->OpenSession(TestHello(agent)).ok());
  }
  store_.Hold();
  std::vector<std::future<StatusOr<IngestVerdict>>> verdicts;
  verdicts.push_back(Submit("a", 0));
  store_.WaitUntilHeld();
  for (const char* agent : {"b", "c", "d"}) verdicts.push_back(Submit(agent, 0));
  store_.Release();
  for (auto& verdict : verdicts) EXPECT_TRUE(verdict.get()->accepted);
  EXPECT_THAT(store_.group_sizes(), ElementsAre(1, 3));
}

// A connection broke while a submap waited, and the agent sent it again: each of them would stay,
// and the second be rejected.
TEST_F(IngestTest, OnlyTheNewestUploadOfASessionWaits) {
  Start();
  for (const char* agent : {"a", "b"}) ingest_->OpenSession(TestHello(agent)).value();
  store_.Hold();
  auto b0 = Submit("b", 0);
  store_.WaitUntilHeld();
  std::vector<std::future<StatusOr<IngestVerdict>>> repeated;
  for (int i = 0; i < 20; ++i) repeated.push_back(Submit("a", 0));
  for (int i = 0; i < 19; ++i) {
    ASSERT_EQ(repeated[i].wait_for(std::chrono::seconds(0)), std::future_status::ready);
    EXPECT_TRUE(absl::IsUnavailable(repeated[i].get().status()));
  }
  store_.Release();
  EXPECT_TRUE(repeated.back().get()->accepted);
  EXPECT_TRUE(b0.get()->accepted);
  EXPECT_THAT(integrated(), ElementsAre("b/0", "a/0"));
}

TEST_F(IngestTest, FailedCommitIsUnavailableNeverAccepted) {
  Start();
  ASSERT_TRUE(ingest_->OpenSession(TestHello("a")).ok());
  store_.Fail();
  const auto verdict = Submit("a", 0).get();
  EXPECT_TRUE(absl::IsUnavailable(verdict.status())) << verdict.status();
  EXPECT_EQ(store_failures_, 1);
  EXPECT_THAT(integrated(), IsEmpty());
}

TEST_F(IngestTest, SessionContradictingItsCameraIsRefused) {
  Start();
  SessionHello hello = TestHello("a");
  ASSERT_TRUE(ingest_->OpenSession(hello).ok());
  hello.camera.fx_px += 1;
  EXPECT_TRUE(absl::IsFailedPrecondition(ingest_->OpenSession(hello).status()));
  hello = TestHello("b");
  hello.camera.fx_px = -1;
  EXPECT_TRUE(absl::IsInvalidArgument(ingest_->OpenSession(hello).status()));
}

TEST_F(IngestTest, FinishedSessionTakesNoNewSubmaps) {
  Start();
  ASSERT_TRUE(ingest_->OpenSession(TestHello("a")).ok());
  EXPECT_TRUE(Submit("a", 0).get()->accepted);
  int done = 0;
  ingest_->FinishSession(TestSession("a"), [&](const Status& status) { done += status.ok(); });
  EXPECT_EQ(done, 1);
  EXPECT_TRUE(Submit("a", 0).get()->accepted) << "known ones are still acknowledged";
  EXPECT_FALSE(Submit("a", 1).get()->accepted);
}

TEST_F(IngestTest, LockstepTakesSubmapsInTurnWhateverTheirArrival) {
  Start({.lockstep_agents = {AgentId("b"), AgentId("a")}});
  ASSERT_TRUE(ingest_->OpenSession(TestHello("a")).ok());
  ASSERT_TRUE(ingest_->OpenSession(TestHello("b")).ok());
  auto a0 = Submit("a", 0);
  EXPECT_EQ(a0.wait_for(std::chrono::milliseconds(20)), std::future_status::timeout);
  EXPECT_TRUE(Submit("b", 0).get()->accepted);
  EXPECT_TRUE(a0.get()->accepted);
  EXPECT_TRUE(Submit("b", 1).get()->accepted);
  auto b2 = Submit("b", 2);
  EXPECT_TRUE(Submit("a", 1).get()->accepted);
  EXPECT_TRUE(b2.get()->accepted);
  int done = 0;
  ingest_->FinishSession(TestSession("b"), [&](const Status& status) { done += status.ok(); });
  EXPECT_EQ(done, 0) << "a has not finished";
  EXPECT_TRUE(Submit("a", 2).get()->accepted);
  EXPECT_TRUE(Submit("a", 3).get()->accepted);
  EXPECT_THAT(integrated(), ElementsAre("b/0", "a/0", "b/1", "a/1", "b/2", "a/2", "a/3"));
  ingest_->FinishSession(TestSession("a"), [&](const Status& status) { done += status.ok(); });
  EXPECT_EQ(done, 2);
}

TEST_F(IngestTest, LockstepRefusesUndeclaredAgents) {
  Start({.lockstep_agents = {AgentId("a")}});
  EXPECT_TRUE(absl::IsFailedPrecondition(ingest_->OpenSession(TestHello("b")).status()));
}

TEST_F(IngestTest, LockstepGoesOnAfterARestart) {
  StoredMap map;
  for (const char* agent : {"a", "b"}) {
    map.sessions.push_back({AgentId(agent), SessionId(1), testing::TestCamera(), false});
  }
  map.sessions[0].finished = true;
  ASSERT_TRUE(sessions_.Restore(map).ok());
  for (const SessionRecord& session : map.sessions) ASSERT_TRUE(store_.AddSession(session).ok());
  Start({.lockstep_agents = {AgentId("a"), AgentId("b")}});
  EXPECT_TRUE(Submit("b", 0).get()->accepted) << "a is done and is not waited for";
}

TEST_F(IngestTest, ShutdownAnswersWhatWaits) {
  Start({.lockstep_agents = {AgentId("a"), AgentId("b")}});
  ASSERT_TRUE(ingest_->OpenSession(TestHello("b")).ok());
  ASSERT_TRUE(ingest_->OpenSession(TestHello("a")).ok());
  auto b0 = Submit("b", 0);
  Status finished;
  ingest_->FinishSession(TestSession("b"), [&](const Status& status) { finished = status; });
  ingest_->Shutdown();
  EXPECT_TRUE(absl::IsUnavailable(b0.get().status()));
  EXPECT_TRUE(absl::IsUnavailable(finished));
  EXPECT_TRUE(absl::IsUnavailable(Submit("a", 0).get().status()));
}

}  // namespace
}  // namespace portolan
