// Time of each stage of the map builder and of the full adjustment.
#include <benchmark/benchmark.h>

#include "server/map_builder.h"
#include "server/refinement/submap_refiner.h"
#include "tests/support/synthetic_map.h"

namespace portolan {
namespace {

SyntheticSubmapsOptions Fleet(int submaps_per_agent) {
  SyntheticSubmapsOptions options;
  const double length = 0.5 * submaps_per_agent;
  options.agents = {{0, length, submaps_per_agent, 1.5},
                    {2.0, 2.0 + length, submaps_per_agent, 1.4},
                    {4.0, 4.0 + length, submaps_per_agent, 1.6}};
  options.max_observations = 200;
  return options;
}

void BM_RefineSubmap(benchmark::State& state) {
  const SyntheticMission mission = MakeSyntheticMission(Fleet(1));
  const SubmapRefiner refiner = SubmapRefiner::Create({}).value();
  for (auto _ : state) {
    benchmark::DoNotOptimize(
        refiner.Refine(mission.submaps[0].id, mission.submaps[0].submap, mission.camera));
  }
}
BENCHMARK(BM_RefineSubmap)->Unit(benchmark::kMillisecond);

void Report(const char* name, const StageTime& stage, benchmark::State* state) {
  if (stage.count > 0) {
    state->counters[name] = stage.total_ms / static_cast<double>(stage.count);
  }
}

// Three agents, state.range(0) submaps each; counters: mean milliseconds of each stage, keyframe
// error in millimetres.
void BM_IntegrateMission(benchmark::State& state) {
  const SyntheticMission mission = MakeSyntheticMission(Fleet(static_cast<int>(state.range(0))));
  for (auto _ : state) {
    auto builder = MapBuilder::Create({}).value();
    IntegrateMission(mission, 0, mission.submaps.size(), state.range(1) != 0, builder.get());
    FinishBackgroundWork(builder.get());
    const StageTimes& times = builder->stage_times();
    Report("refine", times.refine, &state);
    Report("link", times.link, &state);
    Report("recognise", times.recognise, &state);
    Report("verify", times.verify, &state);
    Report("align", times.align, &state);
    Report("fuse", times.fuse, &state);
    Report("background", times.background, &state);
    state.counters["rms_mm"] = 1e3 * KeyframeRms(mission, *builder->snapshot(), ComponentId(1));
    state.counters["components"] = static_cast<double>(builder->snapshot()->components.size());
    state.counters["closures"] = static_cast<double>(builder->snapshot()->closures->size());
  }
}
BENCHMARK(BM_IntegrateMission)
    ->Args({5, 1})
    ->Args({5, 0})
    ->Args({7, 0})
    ->Iterations(1)
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace portolan

BENCHMARK_MAIN();
