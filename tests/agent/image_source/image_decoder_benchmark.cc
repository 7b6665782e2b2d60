// Time to read one image file as grey; the files are in the page cache.
#include <benchmark/benchmark.h>

#include "agent/image_source/image_source.h"
#include "tests/support/data_path.h"

namespace portolan {
namespace {

void ReadSequence(benchmark::State& state, const char* relative) {
  const auto path = RealDataPath(relative);
  if (!path) {
    state.SkipWithError("no real data; set PORTOLAN_DATA");
    return;
  }
  ImageSourceOptions options;
  options.path = path->string();
  std::unique_ptr<ImageSource> source;
  for (auto _ : state) {
    auto frame = source ? source->Next() : std::optional<Frame>();
    if (!frame.ok() || !frame->has_value()) {
      state.PauseTiming();
      source = OpenImageSource(options).value();
      state.ResumeTiming();
      frame = source->Next();
    }
    benchmark::DoNotOptimize(frame);
  }
}

BENCHMARK_CAPTURE(ReadSequence, colour_640x480, "7scenes/redkitchen_seq-01")
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(ReadSequence, grey_752x480, "euroc/MH_01_easy_first18s")
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(ReadSequence, grey_1241x376, "kitti/odometry_00_first200")
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(ReadSequence, grey_320x240, "monoslam_davison/scenelib_test_sequence")
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace portolan

BENCHMARK_MAIN();
