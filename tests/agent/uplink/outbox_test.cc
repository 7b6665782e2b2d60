#include "agent/uplink/outbox.h"

#include <sys/wait.h>
#include <unistd.h>

#include <fstream>

#include "tests/agent/uplink/uplink_test_support.h"

namespace portolan {
namespace {

using testing::HasSubstr;

std::vector<uint32_t> Pending(const Outbox& outbox) {
  std::vector<uint32_t> numbers;
  for (auto n = outbox.NextPending(0); n.has_value(); n = outbox.NextPending(*n + 1)) {
    numbers.push_back(*n);
  }
  return numbers;
}

void Damage(const std::filesystem::path& file) {
  std::fstream stream(file, std::ios::in | std::ios::out | std::ios::binary);
  stream.seekp(25);
  stream.put('\x7f');
}

TEST(Outbox, KeepsSubmapsInOrder) {
  const TempDir dir;
  const auto outbox = NewOutbox(dir);
  for (const uint32_t n : {0u, 1u, 5u})
    ASSERT_THAT(outbox->Append(n, "bytes" + std::to_string(n)), IsOk());
  EXPECT_THAT(Pending(*outbox), testing::ElementsAre(0, 1, 5));
  EXPECT_EQ(outbox->next_sequence_number(), 6u);
  EXPECT_EQ(*outbox->Read(5), "bytes5");
  EXPECT_EQ(outbox->pending_bytes(), 18u);
  outbox->Remove(1);
  outbox->Remove(1);
  outbox->Remove(77);
  EXPECT_THAT(Pending(*outbox), testing::ElementsAre(0, 5));
  outbox->RemoveBelow(5);
  EXPECT_THAT(Pending(*outbox), testing::ElementsAre(5));
  EXPECT_EQ(outbox->pending_bytes(), 6u);
}

TEST(Outbox, RefusesNumbersThatDoNotAscend) {
  const TempDir dir;
  const auto outbox = NewOutbox(dir);
  ASSERT_THAT(outbox->Append(3, "x"), IsOk());
  EXPECT_THAT(outbox->Append(3, "y"), StatusIs(absl::StatusCode::kAlreadyExists));
  EXPECT_THAT(outbox->Append(2, "y"), StatusIs(absl::StatusCode::kAlreadyExists));
  EXPECT_EQ(*outbox->Read(3), "x");
}

TEST(Outbox, SurvivesReopening) {
  const TempDir dir;
  std::filesystem::path folder;
  {
    const auto outbox = NewOutbox(dir);
    folder = outbox->folder();
    for (uint32_t n = 0; n < 3; ++n) ASSERT_THAT(outbox->Append(n, std::string(n, 'x')), IsOk());
    outbox->Remove(0);
  }
  std::ofstream(folder / "0000000003.submap.tmp") << "cut short";
  EXPECT_THAT(Outbox::FindPendingSessions(dir.path()), testing::ElementsAre(folder));
  const auto outbox = Outbox::Open(folder, OutboxOptions());
  ASSERT_THAT(outbox, IsOk());
  EXPECT_EQ((*outbox)->hello().session, TestHello().session);
  EXPECT_EQ((*outbox)->hello().camera, TestHello().camera);
  EXPECT_THAT(Pending(**outbox), testing::ElementsAre(1, 2));
  EXPECT_EQ(*(*outbox)->Read(2), "xx");
  EXPECT_FALSE(std::filesystem::exists(folder / "0000000003.submap.tmp"));
}

TEST(Outbox, SurvivesAKilledProcess) {
  const TempDir dir;
  const pid_t child = fork();
  if (child == 0) {
    auto outbox = Outbox::Create(dir.path(), TestHello(), OutboxOptions());
    for (uint32_t n = 0; outbox.ok() && n < 4; ++n) {
      if (!(*outbox)->Append(n, "submap").ok()) _exit(1);
    }
    kill(getpid(), SIGKILL);
  }
  int status = 0;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  ASSERT_TRUE(WIFSIGNALED(status));
  const auto folders = Outbox::FindPendingSessions(dir.path());
  ASSERT_EQ(folders.size(), 1u);
  const auto outbox = Outbox::Open(folders[0], OutboxOptions());
  ASSERT_THAT(outbox, IsOk());
  EXPECT_THAT(Pending(**outbox), testing::ElementsAre(0, 1, 2, 3));
}

TEST(Outbox, SetsDamagedFilesAsideAndLosesNothingElse) {
  const TempDir dir;
  const auto outbox = NewOutbox(dir);
  for (uint32_t n = 0; n < 3; ++n) ASSERT_THAT(outbox->Append(n, "some bytes"), IsOk());
  Damage(outbox->folder() / "0000000001.submap");
  EXPECT_THAT(outbox->Read(1), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("checksum")));
  EXPECT_THAT(Pending(*outbox), testing::ElementsAre(0, 2));
  EXPECT_TRUE(std::filesystem::exists(outbox->folder() / "0000000001.submap.corrupt"));
  EXPECT_THAT(outbox->Read(2), IsOk());
  std::filesystem::remove(outbox->folder() / "0000000002.submap");
  EXPECT_THAT(outbox->Read(2), StatusIs(absl::StatusCode::kDataLoss));
  EXPECT_THAT(Pending(*outbox), testing::ElementsAre(0));
}

TEST(Outbox, RefusesTheNewSubmapWhenFull) {
  const TempDir dir;
  const auto outbox = NewOutbox(dir, {.max_bytes = 2 << 20});
  const std::string half(1 << 20, 'x');
  ASSERT_THAT(outbox->Append(0, half), IsOk());
  ASSERT_THAT(outbox->Append(1, half), IsOk());
  EXPECT_THAT(outbox->Append(2, half), StatusIs(absl::StatusCode::kResourceExhausted));
  EXPECT_THAT(Pending(*outbox), testing::ElementsAre(0, 1));
  outbox->Remove(0);
  EXPECT_THAT(outbox->Append(3, half), IsOk());
  EXPECT_THAT(Pending(*outbox), testing::ElementsAre(1, 3));
}

TEST(Outbox, IsUsedByOneOwnerAtATime) {
  const TempDir dir;
  const auto outbox = NewOutbox(dir);
  EXPECT_THAT(Outbox::Open(outbox->folder(), OutboxOptions()),
              StatusIs(absl::StatusCode::kUnavailable, HasSubstr("in use")));
  EXPECT_THAT(Outbox::Create(dir.path(), TestHello(), OutboxOptions()),
              StatusIs(absl::StatusCode::kAlreadyExists));
}

TEST(Outbox, ReportsADamagedSessionFile) {
  const TempDir dir;
  const auto folder = NewOutbox(dir)->folder();
  Damage(folder / "session");
  EXPECT_THAT(Outbox::Open(folder, OutboxOptions()), StatusIs(absl::StatusCode::kDataLoss));
}

TEST(Outbox, KeepsRejectedSubmapsWithTheReason) {
  const TempDir dir;
  const auto outbox = NewOutbox(dir);
  ASSERT_THAT(outbox->Append(0, "x"), IsOk());
  outbox->SetAsideRejected(0, "implausible");
  EXPECT_EQ(outbox->pending_count(), 0u);
  std::ifstream reason(outbox->folder() / "0000000000.submap.rejected.txt");
  std::string text;
  std::getline(reason, text);
  EXPECT_EQ(text, "implausible");
  outbox->RemoveIfDone();
  EXPECT_TRUE(std::filesystem::exists(outbox->folder()));
}

TEST(Outbox, RemovesFoldersOfDoneSessionsOnly) {
  const TempDir dir;
  SessionHello other = TestHello();
  other.session = SessionId(2);
  std::filesystem::path done, pending;
  {
    const auto outbox = NewOutbox(dir);
    done = outbox->folder();
    const auto second = Outbox::Create(dir.path(), other, OutboxOptions());
    ASSERT_THAT((*second)->Append(0, "x"), IsOk());
    pending = (*second)->folder();
    Outbox::RemoveDoneSessions(dir.path());
    EXPECT_TRUE(std::filesystem::exists(done)) << "in use";
  }
  Outbox::RemoveDoneSessions(dir.path());
  EXPECT_FALSE(std::filesystem::exists(done));
  EXPECT_TRUE(std::filesystem::exists(pending));
}

TEST(DrawSessionId, GivesDifferentIds) { EXPECT_NE(DrawSessionId(), DrawSessionId()); }

}  // namespace
}  // namespace portolan
