// The store under disk errors and sudden death.
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include "server/store/sqlite_map_store.h"
#include "tests/server/store/faulty_vfs.h"
#include "tests/server/store/store_test_util.h"
#include "tests/support/temp_dir.h"

namespace portolan {
namespace {

using testing::DecodeTestSubmap;
using testing::FaultyVfs;
using testing::MakeSession;
using testing::MakeState;
using testing::MakeSubmap;

class StoreFaultTest : public ::testing::TestWithParam<FaultyVfs::Fault> {
 protected:
  StoreFaultTest() { FaultyVfs::Heal(); }
  ~StoreFaultTest() override { FaultyVfs::Heal(); }

  std::string path() const { return (directory_ / "map.portolan").string(); }
  std::unique_ptr<SqliteMapStore> OpenFaulty() {
    SqliteMapStoreOptions options;
    options.vfs = FaultyVfs::name();
    auto store = SqliteMapStore::Open(path(), options);
    EXPECT_TRUE(store.ok()) << store.status();
    return *std::move(store);
  }
  size_t CountSubmaps() {
    return (*SqliteMapStore::Open(path()))->Load(DecodeTestSubmap)->submaps.size();
  }

  TempDir directory_;
};

// Whatever operation of a commit fails: what was acknowledged is there, what was not may be
// there or not, and the store takes no more writes.
TEST_P(StoreFaultTest, FailedCommitIsReportedAndEndsWriting) {
  for (int fail_after = 0; fail_after < 4; ++fail_after) {
    const TempDir directory;
    SqliteMapStoreOptions options;
    options.vfs = FaultyVfs::name();
    auto store = *SqliteMapStore::Open((directory / "map").string(), options);
    ASSERT_TRUE(store->AddSession(MakeSession("a", 1)).ok());
    ASSERT_TRUE(store->AppendSubmaps({MakeSubmap("a", 1, 0)}).ok());
    FaultyVfs::FailAfter(fail_after, GetParam());
    const auto failed = store->AppendSubmaps({MakeSubmap("a", 1, 1)});
    const bool was_reached = FaultyVfs::operation_count() > fail_after;
    FaultyVfs::Heal();
    if (!was_reached) break;  // the whole commit takes fewer operations
    ASSERT_FALSE(failed.ok()) << "fail_after " << fail_after;
    EXPECT_TRUE(absl::IsFailedPrecondition(store->AppendSubmaps({MakeSubmap("a", 1, 1)}).status()));
    EXPECT_TRUE(absl::IsFailedPrecondition(store->SaveSnapshot({})));
    store.reset();
    auto reopened = *SqliteMapStore::Open((directory / "map").string());
    const auto map = reopened->Load(DecodeTestSubmap);
    ASSERT_TRUE(map.ok()) << map.status();
    ASSERT_GE(map->submaps.size(), 1u);
    EXPECT_TRUE(reopened->AppendSubmaps({MakeSubmap("a", 1, map->submaps.size())}).ok());
  }
}

TEST_P(StoreFaultTest, FailedSaveLeavesThePreviousSnapshot) {
  {
    auto store = OpenFaulty();
    ASSERT_TRUE(store->AddSession(MakeSession("a", 1)).ok());
    ASSERT_TRUE(store->AppendSubmaps({MakeSubmap("a", 1, 0)}).ok());
    const StoredMap map = *store->Load(DecodeTestSubmap);
    MapSnapshot snapshot;
    snapshot.version = 1;
    snapshot.submaps = {MakeState(map.submaps[0], ComponentId(1), {0, 0, 0}, 5, 1)};
    ASSERT_TRUE(store->SaveSnapshot(snapshot).ok());
    snapshot.version = 2;
    snapshot.submaps = {MakeState(map.submaps[0], ComponentId(1), {0, 0, 0}, 2000, 2)};
    FaultyVfs::FailAfter(3, GetParam());
    EXPECT_FALSE(store->SaveSnapshot(snapshot).ok());
    FaultyVfs::Heal();
  }
  const StoredMap map = *(*SqliteMapStore::Open(path()))->Load(DecodeTestSubmap);
  ASSERT_NE(map.snapshot, nullptr);
  EXPECT_EQ(map.snapshot->version, 1u);
  EXPECT_EQ(map.snapshot->submaps[0]->landmarks.size(), 5u);
}

INSTANTIATE_TEST_SUITE_P(Faults, StoreFaultTest,
                         ::testing::Values(FaultyVfs::Fault::kDiskFull,
                                           FaultyVfs::Fault::kInputOutputError));

// A child commits and tells each acknowledged submap through a pipe until it is killed.
[[noreturn]] void CommitForever(const std::string& path, int pipe_end) {
  auto store = SqliteMapStore::Open(path);
  if (!store.ok() || !(*store)->AddSession(MakeSession("a", 1)).ok()) _exit(1);
  for (uint32_t i = 0;; ++i) {
    if (!(*store)->AppendSubmaps({MakeSubmap("a", 1, i)}).ok()) _exit(1);
    if (write(pipe_end, &i, sizeof(i)) != sizeof(i)) _exit(1);
  }
}

TEST(StoreCrashTest, EverySubmapAcknowledgedBeforeSigkillIsThereOnce) {
  const TempDir directory;
  const std::string path = (directory / "map").string();
  int ends[2];
  ASSERT_EQ(pipe(ends), 0);
  const pid_t child = fork();
  ASSERT_GE(child, 0);
  if (child == 0) CommitForever(path, ends[1]);
  close(ends[1]);
  uint32_t acknowledged = 0;
  while (acknowledged < 20 &&
         read(ends[0], &acknowledged, sizeof(acknowledged)) == sizeof(acknowledged)) {
  }
  kill(child, SIGKILL);
  while (read(ends[0], &acknowledged, sizeof(acknowledged)) == sizeof(acknowledged)) {
  }
  waitpid(child, nullptr, 0);
  close(ends[0]);
  ASSERT_GE(acknowledged, 20u);
  const auto map = (*SqliteMapStore::Open(path))->Load(DecodeTestSubmap);
  ASSERT_TRUE(map.ok()) << map.status();
  ASSERT_GE(map->submaps.size(), acknowledged + 1);
  for (size_t i = 0; i < map->submaps.size(); ++i) {
    EXPECT_EQ(map->submaps[i].submap->key.sequence_number, i);
    EXPECT_EQ(map->submaps[i].id, SubmapId(static_cast<int64_t>(i) + 1));
  }
}

}  // namespace
}  // namespace portolan
