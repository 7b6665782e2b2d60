#include "server/store/sqlite_map_store.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "tests/server/store/faulty_vfs.h"
#include "tests/server/store/store_test_util.h"
#include "tests/support/temp_dir.h"

namespace portolan {
namespace {

using testing::DecodeTestSubmap;
using ::testing::ElementsAre;
using testing::ExpectSameSnapshot;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::MakeClosure;
using testing::MakeSession;
using testing::MakeState;
using testing::MakeSubmap;
using ::testing::SizeIs;

class SqliteMapStoreTest : public ::testing::Test {
 protected:
  std::string path() const { return (directory_ / "map.portolan").string(); }

  std::unique_ptr<SqliteMapStore> Open() {
    auto store = SqliteMapStore::Open(path());
    EXPECT_TRUE(store.ok()) << store.status();
    return *std::move(store);
  }

  // A store with one session and `count` submaps.
  std::unique_ptr<SqliteMapStore> OpenWithSubmaps(int count) {
    auto store = Open();
    EXPECT_TRUE(store->AddSession(MakeSession("a", 7)).ok());
    for (int i = 0; i < count; ++i) {
      EXPECT_TRUE(store->AppendSubmaps({MakeSubmap("a", 7, i)}).ok());
    }
    return store;
  }

  static StoredMap Load(SqliteMapStore& store) {
    auto map = store.Load(DecodeTestSubmap);
    EXPECT_TRUE(map.ok()) << map.status();
    return *std::move(map);
  }

  static MapSnapshot MakeSnapshot(const StoredMap& map, unsigned seed) {
    MapSnapshot snapshot;
    snapshot.version = seed;
    for (const StoredSubmap& submap : map.submaps) {
      snapshot.submaps.push_back(MakeState(submap, ComponentId(1), {10.0 * submap.id.value(), 0, 0},
                                           5, seed + submap.id.value()));
    }
    snapshot.components = {{ComponentId(1), true, false, nullptr}};
    snapshot.closures = std::make_shared<const ClosureList>(
        std::vector<Closure>{MakeClosure(SubmapId(1), SubmapId(2), 3)});
    snapshot.waiting_closures = std::make_shared<const ClosureList>(
        std::vector<Closure>{MakeClosure(SubmapId(2), SubmapId(1), 4)});
    return snapshot;
  }

  TempDir directory_;
};

TEST_F(SqliteMapStoreTest, NewFileIsEmpty) {
  const StoredMap map = Load(*Open());
  EXPECT_THAT(map.sessions, IsEmpty());
  EXPECT_THAT(map.submaps, IsEmpty());
  EXPECT_EQ(map.snapshot, nullptr);
  EXPECT_EQ(map.derived_problem, "");
}

TEST_F(SqliteMapStoreTest, SubmapsAndSessionsSurviveReopening) {
  {
    auto store = Open();
    ASSERT_TRUE(store->AddSession(MakeSession("a", 0xfedcba9876543210u)).ok());
    ASSERT_TRUE(store->AddSession(MakeSession("b", 2)).ok());
    const auto ids = store->AppendSubmaps(
        {MakeSubmap("a", 0xfedcba9876543210u, 0, 3), MakeSubmap("b", 2, 0), MakeSubmap("b", 2, 1)});
    ASSERT_TRUE(ids.ok()) << ids.status();
    EXPECT_THAT(*ids, ElementsAre(SubmapId(1), SubmapId(2), SubmapId(3)));
    ASSERT_TRUE(store->FinishSession(AgentId("b"), SessionId(2)).ok());
  }
  auto store = Open();
  const StoredMap map = Load(*store);
  ASSERT_THAT(map.sessions, SizeIs(2));
  EXPECT_EQ(map.sessions[0].session, SessionId(0xfedcba9876543210u));
  EXPECT_EQ(map.sessions[0].camera, MakeSession("a", 1).camera);
  EXPECT_FALSE(map.sessions[0].finished);
  EXPECT_TRUE(map.sessions[1].finished);
  ASSERT_THAT(map.submaps, SizeIs(3));
  EXPECT_THAT(map.submaps[0].submap->keyframes, SizeIs(3));
  EXPECT_EQ(map.submaps[2].submap->key.sequence_number, 1u);
  EXPECT_EQ(map.submaps[1].camera, map.submaps[2].camera);
  // Sessions are known after reopening, without adding them again.
  EXPECT_TRUE(store->AppendSubmaps({MakeSubmap("b", 2, 2)}).ok());
}

TEST_F(SqliteMapStoreTest, DuplicateIsRefusedAndWritesNothing) {
  auto store = OpenWithSubmaps(1);
  const auto ids = store->AppendSubmaps({MakeSubmap("a", 7, 1), MakeSubmap("a", 7, 0)});
  EXPECT_TRUE(absl::IsAlreadyExists(ids.status())) << ids.status();
  EXPECT_THAT(Load(*store).submaps, SizeIs(1));
  EXPECT_TRUE(store->AppendSubmaps({MakeSubmap("a", 7, 1)}).ok()) << "the store still works";
}

TEST_F(SqliteMapStoreTest, UnknownSessionIsRefused) {
  auto store = OpenWithSubmaps(0);
  EXPECT_TRUE(absl::IsNotFound(store->AppendSubmaps({MakeSubmap("b", 7, 0)}).status()));
  EXPECT_TRUE(absl::IsNotFound(store->FinishSession(AgentId("a"), SessionId(8))));
}

TEST_F(SqliteMapStoreTest, SessionKeepsItsCalibration) {
  auto store = OpenWithSubmaps(0);
  SessionRecord session = MakeSession("a", 7);
  EXPECT_TRUE(store->AddSession(session).ok());
  session.camera.fx_px += 1;
  EXPECT_TRUE(absl::IsFailedPrecondition(store->AddSession(session)));
}

TEST_F(SqliteMapStoreTest, SnapshotSurvivesReopening) {
  MapSnapshot snapshot;
  {
    auto store = OpenWithSubmaps(3);
    snapshot = MakeSnapshot(Load(*store), 10);
    ASSERT_TRUE(store->SaveSnapshot(snapshot).ok());
  }
  const StoredMap map = Load(*Open());
  ASSERT_NE(map.snapshot, nullptr) << map.derived_problem;
  ExpectSameSnapshot(*map.snapshot, snapshot);
  EXPECT_EQ(map.snapshot->submaps[0]->refined->raw, map.submaps[0].submap);
}

TEST_F(SqliteMapStoreTest, IncrementalSavesAddUpToTheNewestSnapshot) {
  MapSnapshot snapshot;
  {
    auto store = OpenWithSubmaps(4);
    const StoredMap map = Load(*store);
    snapshot = MakeSnapshot(map, 10);
    ASSERT_TRUE(store->SaveSnapshot(snapshot).ok());
    snapshot.version = 11;
    snapshot.submaps[2] = MakeState(map.submaps[2], ComponentId(1), {0, 5, 0}, 7, 99);
    snapshot.submaps.pop_back();
    snapshot.closures = std::make_shared<const ClosureList>(std::vector<Closure>{
        MakeClosure(SubmapId(1), SubmapId(3), 2), MakeClosure(SubmapId(2), SubmapId(3), 5)});
    ASSERT_TRUE(store->SaveSnapshot(snapshot).ok());
    snapshot.version = 12;
    snapshot.closures =
        std::make_shared<const ClosureList>(std::vector<Closure>{(*snapshot.closures)[1]});
    ASSERT_TRUE(store->SaveSnapshot(snapshot).ok());
  }
  auto store = Open();
  ExpectSameSnapshot(*Load(*store).snapshot, snapshot);
}

TEST_F(SqliteMapStoreTest, UnchangedStatesAreNotWrittenAgain) {
  // A row that grows may move a few pages' worth of its neighbours: 17 to 27 writes instead of 353.
  OpenWithSubmaps(400).reset();
  SqliteMapStoreOptions options;
  options.vfs = testing::FaultyVfs::name();
  auto store = *SqliteMapStore::Open(path(), options);
  const StoredMap map = Load(*store);
  MapSnapshot snapshot = MakeSnapshot(map, 10);
  testing::FaultyVfs::Heal();
  ASSERT_TRUE(store->SaveSnapshot(snapshot).ok());
  const int full_save = testing::FaultyVfs::operation_count();
  snapshot.version = 11;
  snapshot.submaps[20] = MakeState(map.submaps[20], ComponentId(1), {0, 5, 0}, 7, 99);
  testing::FaultyVfs::Heal();
  ASSERT_TRUE(store->SaveSnapshot(snapshot).ok());
  EXPECT_LT(10 * testing::FaultyVfs::operation_count(), full_save);
  ExpectSameSnapshot(*Load(*store).snapshot, snapshot);
}

TEST_F(SqliteMapStoreTest, DropDerivedKeepsTheRawSubmaps) {
  auto store = OpenWithSubmaps(2);
  ASSERT_TRUE(store->SaveSnapshot(MakeSnapshot(Load(*store), 10)).ok());
  ASSERT_TRUE(store->DropDerived().ok());
  const StoredMap map = Load(*store);
  EXPECT_EQ(map.snapshot, nullptr);
  EXPECT_THAT(map.submaps, SizeIs(2));
  const MapSnapshot rebuilt = MakeSnapshot(map, 30);
  ASSERT_TRUE(store->SaveSnapshot(rebuilt).ok());
  ExpectSameSnapshot(*Load(*store).snapshot, rebuilt);
}

TEST_F(SqliteMapStoreTest, FindsSubmapsByTheBoundsOfTheirLandmarks) {
  auto store = OpenWithSubmaps(3);
  MapSnapshot snapshot = MakeSnapshot(Load(*store), 10);  // around x = 10, 20 and 30
  ASSERT_TRUE(store->SaveSnapshot(snapshot).ok());
  const Box box{{14, -20, -20}, {40, 20, 20}};
  EXPECT_THAT(*store->SubmapsInBox(ComponentId(1), box), ElementsAre(SubmapId(2), SubmapId(3)));
  EXPECT_THAT(*store->SubmapsInBox(ComponentId(2), box), IsEmpty());
}

TEST_F(SqliteMapStoreTest, SecondOpenIsRefusedAsInUse) {
  auto store = OpenWithSubmaps(1);
  const auto second = SqliteMapStore::Open(path());
  EXPECT_TRUE(absl::IsUnavailable(second.status())) << second.status();
  EXPECT_THAT(std::string(second.status().message()), HasSubstr("in use by another server"));
}

TEST_F(SqliteMapStoreTest, ForeignFilesAreNamedAsSuch) {
  std::ofstream(path()) << "This is a text file that is long enough to have a header of its own, "
                           "but it is no database at all, whatever its name may say.";
  const auto store = SqliteMapStore::Open(path());
  EXPECT_TRUE(absl::IsDataLoss(store.status())) << store.status();
  EXPECT_THAT(std::string(store.status().message()), HasSubstr(path()));
}

TEST_F(SqliteMapStoreTest, DatabaseOfAnotherProgramIsNotTouched) {
  {
    auto other = SqliteDatabase::Open(path(), "");
    ASSERT_TRUE((*other)->Execute("CREATE TABLE recipes (name TEXT)").ok());
  }
  const auto store = SqliteMapStore::Open(path());
  EXPECT_TRUE(absl::IsDataLoss(store.status())) << store.status();
  auto other = SqliteDatabase::Open(path(), "");
  EXPECT_EQ(*(*other)->QueryInteger("SELECT count(*) FROM sqlite_master"), 1);
}

Survey MakeSurvey() {
  Survey survey;
  for (const char* id : {"P1", "P2"}) {
    ControlPoint point;
    point.id = id;
    point.sigma_m = 0.05;
    point.observations.push_back(
        {AgentId("a"), SessionId(0xf000000000000007), Timestamp(5), {1.5, 2.5}, 0.5});
    point.observations.push_back({AgentId("a"), std::nullopt, Timestamp(6), {3, 4}, 1});
    survey.points.push_back(point);
  }
  survey.points[0].grid_m = Eigen::Vector3d(2600000.123, 1200000.456, 400);
  survey.points[1].geodetic = GeodeticPosition{47.123456789, -8.5, 399.5};
  survey.origin = SiteOrigin{GeodeticPosition{47, 8, 400}, {2600000, 1200000, 400}};
  return survey;
}

void ExpectSameSurvey(const Survey& actual, const Survey& expected) {
  EXPECT_EQ(actual.origin, expected.origin);
  ASSERT_EQ(actual.points.size(), expected.points.size());
  for (size_t i = 0; i < actual.points.size(); ++i) {
    const ControlPoint &a = actual.points[i], &b = expected.points[i];
    EXPECT_EQ(a.id, b.id);
    EXPECT_EQ(a.geodetic, b.geodetic);
    EXPECT_EQ(a.grid_m, b.grid_m);
    EXPECT_EQ(a.sigma_m, b.sigma_m);
    ASSERT_EQ(a.observations.size(), b.observations.size());
    for (size_t k = 0; k < a.observations.size(); ++k) {
      EXPECT_EQ(a.observations[k].agent, b.observations[k].agent);
      EXPECT_EQ(a.observations[k].session, b.observations[k].session);
      EXPECT_EQ(a.observations[k].time, b.observations[k].time);
      EXPECT_EQ(a.observations[k].pixel, b.observations[k].pixel);
      EXPECT_EQ(a.observations[k].sigma_px, b.observations[k].sigma_px);
    }
  }
}

TEST_F(SqliteMapStoreTest, SurveySurvivesARestartAndARebuild) {
  const Survey survey = MakeSurvey();
  {
    const auto store = OpenWithSubmaps(1);
    ASSERT_TRUE(store->SaveSurvey(MakeSurvey()).ok());
    ASSERT_TRUE(store->SaveSurvey(survey).ok());
    ASSERT_TRUE(store->DropDerived().ok());
  }
  const auto store = Open();
  ExpectSameSurvey(Load(*store).survey, survey);
  ASSERT_TRUE(store->SaveSurvey({}).ok());
  EXPECT_TRUE(Load(*store).survey.empty());
}

TEST_F(SqliteMapStoreTest, FileWithoutSurveyTablesIsMigrated) {
  OpenWithSubmaps(2).reset();
  {
    auto database = SqliteDatabase::Open(path(), "");
    ASSERT_TRUE((*database)
                    ->Execute("DROP TABLE control_observation; DROP TABLE control_point; "
                              "DROP TABLE site_origin; PRAGMA user_version = 1")
                    .ok());
  }
  const auto store = Open();
  EXPECT_THAT(Load(*store).submaps, SizeIs(2));
  EXPECT_TRUE(store->SaveSurvey(MakeSurvey()).ok());
}

TEST_F(SqliteMapStoreTest, DamagedSurveyIsReported) {
  ASSERT_TRUE(OpenWithSubmaps(1)->SaveSurvey(MakeSurvey()).ok());
  {
    auto database = SqliteDatabase::Open(path(), "");
    ASSERT_TRUE((*database)->Execute("UPDATE control_point SET sigma_m = -1").ok());
  }
  const auto map = Open()->Load(DecodeTestSubmap);
  EXPECT_TRUE(absl::IsDataLoss(map.status()));
  EXPECT_THAT(std::string(map.status().message()), HasSubstr("P1"));
}

TEST_F(SqliteMapStoreTest, GeoreferencedComponentStaysSo) {
  const auto store = OpenWithSubmaps(1);
  MapSnapshot snapshot = MakeSnapshot(Load(*store), 3);
  auto report = std::make_shared<GeoreferenceReport>();
  report->is_georeferenced = true;
  report->origin = *MakeSurvey().origin;
  snapshot.components[0].georeference = report;
  ASSERT_TRUE(store->SaveSnapshot(snapshot).ok());
  const StoredMap map = Load(*store);
  ASSERT_TRUE(map.snapshot);
  ASSERT_TRUE(map.snapshot->components[0].georeference);
  EXPECT_TRUE(map.snapshot->components[0].georeference->is_georeferenced);
  EXPECT_EQ(map.snapshot->components[0].georeference->origin, report->origin);
}

TEST_F(SqliteMapStoreTest, NewerSchemaIsRefused) {
  OpenWithSubmaps(1).reset();
  {
    auto database = SqliteDatabase::Open(path(), "");
    ASSERT_TRUE((*database)->Execute("PRAGMA user_version = 99").ok());
  }
  const auto store = SqliteMapStore::Open(path());
  EXPECT_TRUE(absl::IsFailedPrecondition(store.status()));
  EXPECT_THAT(std::string(store.status().message()), HasSubstr("newer"));
}

TEST_F(SqliteMapStoreTest, DamagedRawSubmapIsReported) {
  OpenWithSubmaps(2).reset();
  {
    auto database = SqliteDatabase::Open(path(), "");
    ASSERT_TRUE((*database)
                    ->Execute("DROP TRIGGER raw_submap_is_never_changed; "
                              "UPDATE raw_submap SET bytes = 'a|7|1|9' WHERE id = 2")
                    .ok());
  }
  const auto map = Open()->Load(DecodeTestSubmap);
  EXPECT_TRUE(absl::IsDataLoss(map.status()));
  EXPECT_THAT(std::string(map.status().message()), HasSubstr("raw submap 2"));
}

TEST_F(SqliteMapStoreTest, RawSubmapsAreImmutable) {
  OpenWithSubmaps(1).reset();
  auto database = SqliteDatabase::Open(path(), "");
  EXPECT_FALSE((*database)->Execute("UPDATE raw_submap SET bytes = 'x'").ok());
  EXPECT_FALSE((*database)->Execute("DELETE FROM raw_submap").ok());
}

TEST_F(SqliteMapStoreTest, DamagedDerivedDataAskForARebuild) {
  {
    auto store = OpenWithSubmaps(2);
    ASSERT_TRUE(store->SaveSnapshot(MakeSnapshot(Load(*store), 10)).ok());
  }
  for (const char* damage : {"UPDATE submap_state SET landmarks = x'ff00' WHERE submap_id = 2",
                             "UPDATE submap_state SET pose = x'' WHERE submap_id = 1",
                             "UPDATE map_state SET value = 0 WHERE key = 'derived_version'"}) {
    {
      auto database = SqliteDatabase::Open(path(), "");
      ASSERT_TRUE((*database)->Execute(damage).ok());
    }
    const StoredMap map = Load(*Open());
    EXPECT_EQ(map.snapshot, nullptr) << damage;
    EXPECT_NE(map.derived_problem, "") << damage;
    EXPECT_THAT(map.submaps, SizeIs(2));
  }
}

}  // namespace
}  // namespace portolan
