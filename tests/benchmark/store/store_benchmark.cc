// The map store: commits of raw submaps in groups, incremental and full saves, loading.
#include <benchmark/benchmark.h>

#include <filesystem>
#include <memory>
#include <string>

#include "server/store/sqlite_map_store.h"
#include "tests/server/store/store_test_util.h"
#include "tests/support/temp_dir.h"

namespace portolan {
namespace {

constexpr size_t kSubmapBytes = 40000;

NewSubmap MakeLargeSubmap(uint32_t number) {
  NewSubmap submap = testing::MakeSubmap("a", 1, number, 12);
  submap.bytes.append(kSubmapBytes, '|');
  return submap;
}

StatusOr<Submap> DecodeLargeSubmap(std::string_view bytes) {
  return testing::DecodeTestSubmap(bytes.substr(0, bytes.find("||")));
}

// A store with `count` submaps of 40 kB and a snapshot of 170 landmarks a submap.
struct FilledStore {
  explicit FilledStore(int count) : store(*SqliteMapStore::Open((directory / "map").string())) {
    store->AddSession(testing::MakeSession("a", 1)).IgnoreError();
    std::vector<NewSubmap> submaps;
    for (int i = 0; i < count; ++i) submaps.push_back(MakeLargeSubmap(i));
    store->AppendSubmaps(submaps).status().IgnoreError();
    map = *store->Load(DecodeLargeSubmap);
    snapshot.closures = std::make_shared<const ClosureList>();
    for (const StoredSubmap& submap : map.submaps) snapshot.submaps.push_back(State(submap, 1));
    store->SaveSnapshot(snapshot).IgnoreError();
  }
  static std::shared_ptr<const SubmapState> State(const StoredSubmap& submap, unsigned seed) {
    return testing::MakeState(submap, ComponentId(1), {0, 0, 0}, 170, seed);
  }

  TempDir directory;
  std::unique_ptr<SqliteMapStore> store;
  StoredMap map;
  MapSnapshot snapshot;
};

// One commit of `group` submaps; the counter is submaps a second.
void BM_Commit(benchmark::State& state) {
  const TempDir directory;
  auto store = *SqliteMapStore::Open((directory / "map").string());
  store->AddSession(testing::MakeSession("a", 1)).IgnoreError();
  uint32_t number = 0;
  for (auto _ : state) {
    std::vector<NewSubmap> submaps;
    for (int i = 0; i < state.range(0); ++i) submaps.push_back(MakeLargeSubmap(number++));
    if (!store->AppendSubmaps(submaps).ok()) state.SkipWithError("commit failed");
  }
  state.counters["submaps"] =
      benchmark::Counter(static_cast<double>(number), benchmark::Counter::kIsRate);
}
BENCHMARK(BM_Commit)->Arg(1)->Arg(10)->Arg(64)->Unit(benchmark::kMillisecond)->UseRealTime();

// A save after `changed` of 1,000 submaps changed.
void BM_Save(benchmark::State& state) {
  FilledStore filled(1000);
  unsigned seed = 2;
  for (auto _ : state) {
    state.PauseTiming();
    ++filled.snapshot.version;
    for (int i = 0; i < state.range(0); ++i) {
      filled.snapshot.submaps[i] = FilledStore::State(filled.map.submaps[i], seed++);
    }
    state.ResumeTiming();
    if (!filled.store->SaveSnapshot(filled.snapshot).ok()) state.SkipWithError("save failed");
  }
}
BENCHMARK(BM_Save)->Arg(10)->Arg(1000)->Unit(benchmark::kMillisecond)->UseRealTime();

// Opening and loading a map of 1,000 submaps (without decoding real submaps).
void BM_Load(benchmark::State& state) {
  FilledStore filled(1000);
  for (auto _ : state) {
    benchmark::DoNotOptimize(filled.store->Load(DecodeLargeSubmap));
  }
}
BENCHMARK(BM_Load)->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace
}  // namespace portolan

BENCHMARK_MAIN();
