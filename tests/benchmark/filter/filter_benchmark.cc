// Cost of a frame in the local filter by number of landmarks, all of them measured.
#include <benchmark/benchmark.h>

#include "tests/agent/filter/point_world.h"
#include "tests/agent/filter/turning_world.h"

namespace portolan {
namespace {

struct Setup {
  PointWorldOptions world_options;
  std::unique_ptr<PointWorld> world;
  std::unique_ptr<LocalFilter> filter;

  // frames: how long the filter has run; after few the landmarks are rays, after many points.
  Setup(int landmarks, int frames) {
    world_options.landmarks = landmarks;
    world = std::make_unique<PointWorld>(world_options, MakeTestCamera(),
                                         SwayingTrajectory(0.3, 0.1, 3));
    FilterOptions options;
    options.max_landmarks = landmarks + 10;
    filter = LocalFilter::Create(options, MakeTestCamera(), nullptr).value();
    world->Start(filter.get());
    for (int i = 0; i < frames; ++i) world->Step(filter.get());
  }
};

void BM_Predict(benchmark::State& state) {
  Setup setup(static_cast<int>(state.range(0)), 60);
  for (auto _ : state) {
    setup.filter->Predict(setup.filter->time() + std::chrono::nanoseconds(1));
    benchmark::DoNotOptimize(setup.filter->PredictMeasurements());
  }
}
BENCHMARK(BM_Predict)->Arg(25)->Arg(50)->Arg(100)->Unit(benchmark::kMicrosecond);

// Predict, one-point RANSAC and update, averaged over a running filter: what a frame costs.
void BM_Frame(benchmark::State& state) {
  Setup setup(static_cast<int>(state.range(0)), 60);
  double euclidean = 0, dim = 0;
  for (auto _ : state) {
    state.PauseTiming();
    setup.world->Advance();
    const auto time = setup.world->time();
    const auto measurements = setup.world->Measure(*setup.filter);
    dim += setup.filter->state().dim();
    for (const Landmark& l : setup.filter->state().landmarks()) euclidean += l.euclidean;
    state.ResumeTiming();
    setup.filter->Predict(time);
    benchmark::DoNotOptimize(setup.filter->Update(measurements));
    state.PauseTiming();
    setup.world->Replenish(setup.filter.get());
    state.ResumeTiming();
  }
  state.counters["dim"] = dim / state.iterations();
  state.counters["euclidean"] = euclidean / state.iterations();
}
BENCHMARK(BM_Frame)->Arg(25)->Arg(50)->Arg(100)->Unit(benchmark::kMicrosecond)->Iterations(200);

// The same right after a start, when every landmark is a ray.
void BM_FirstFrames(benchmark::State& state) {
  for (auto _ : state) {
    state.PauseTiming();
    Setup setup(static_cast<int>(state.range(0)), 3);
    setup.world->Advance();
    const auto measurements = setup.world->Measure(*setup.filter);
    state.ResumeTiming();
    setup.filter->Predict(setup.world->time());
    benchmark::DoNotOptimize(setup.filter->Update(measurements));
  }
}
BENCHMARK(BM_FirstFrames)
    ->Arg(25)
    ->Arg(50)
    ->Arg(100)
    ->Unit(benchmark::kMicrosecond)
    ->Iterations(50);

// A camera that looks to and fro, about 40 landmarks in view and the others kept: full (0) against
// compressed (1) update.
void BM_CovarianceUpdate(benchmark::State& state) {
  const auto points = static_cast<int>(state.range(0));
  const double half_arc_rad = points * 1.08 / 80 - 0.4;
  TurningWorld world(points, half_arc_rad, 6.28 * half_arc_rad / 0.5);
  FilterOptions options;
  options.max_landmarks = points;
  options.linearity_threshold = 0.4;
  options.covariance_update =
      state.range(1) == 0 ? CovarianceUpdate::kFull : CovarianceUpdate::kCompressed;
  auto filter = LocalFilter::Create(options, world.camera(), nullptr).value();
  int frame = 0;
  while (frame < 60 || filter->landmark_count() < points) {
    world.Step(frame++, filter.get());
    if (frame > 2000) break;
  }
  double passive = 0;
  for (auto _ : state) {
    world.Step(frame++, filter.get());
    passive += filter->state().passive_count();
  }
  state.counters["landmarks"] = filter->landmark_count();
  state.counters["passive"] = passive / state.iterations();
}
BENCHMARK(BM_CovarianceUpdate)
    ->ArgsProduct({{60, 120, 200}, {0, 1}})
    ->Unit(benchmark::kMicrosecond)
    ->Iterations(300);

void BM_BeginSubmap(benchmark::State& state) {
  Setup setup(static_cast<int>(state.range(0)), 60);
  for (auto _ : state) benchmark::DoNotOptimize(setup.filter->BeginSubmap());
}
BENCHMARK(BM_BeginSubmap)->Arg(25)->Arg(50)->Arg(100)->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace portolan

BENCHMARK_MAIN();
