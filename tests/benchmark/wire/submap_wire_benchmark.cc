// Size by field and time of encoding and decoding a typical submap: 12 keyframes of 200
// observations, 50 landmarks, 2 keyframes of 400 described features, 90 frames.
#include <cstdio>

#include "benchmark/benchmark.h"
#include "common/wire/submap_wire.h"
#include "tests/common/wire/random_submap.h"

namespace portolan {
namespace {

void PrintSizes() {
  v1::Submap message;
  const Submap submap = RandomSubmap({});
  if (!ToProto(submap, &message).ok()) return;
  const WireSizes s = SizesOf(message);
  const auto print = [](const char* name, size_t bytes, size_t count, const char* of) {
    std::printf("%-22s %7zu bytes  %7.2f a %s\n", name, bytes,
                static_cast<double>(bytes) / static_cast<double>(count), of);
  };
  const size_t observations = submap.keyframes.size() * submap.keyframes[0].observations.size();
  const size_t features = 2 * submap.keyframes[0].features.size();
  print("keyframe poses", s.keyframe_poses, submap.keyframes.size(), "keyframe");
  print("keyframe covariances", s.keyframe_covariances, submap.keyframes.size(), "keyframe");
  print("observation tracks", s.observation_tracks, observations, "observation");
  print("observation pixels", s.observation_pixels, observations, "observation");
  print("observation sigmas", s.observation_sigmas, observations, "observation");
  print("feature pixels", s.feature_pixels, features, "feature");
  print("feature attributes", s.feature_attributes, features, "feature");
  print("feature descriptors", s.feature_descriptors, features, "feature");
  print("landmarks", s.landmarks, submap.landmarks.size(), "landmark");
  print("frame times", s.frame_times, submap.frames.size(), "frame");
  print("frame poses", s.frame_poses, submap.frames.size(), "frame");
  print("tags and lengths", s.other, 1, "submap");
  print("total", s.Total(), 1, "submap");
}

void BM_EncodeSubmap(benchmark::State& state) {
  const Submap submap = RandomSubmap({});
  for (auto _ : state) benchmark::DoNotOptimize(EncodeSubmap(submap));
}
BENCHMARK(BM_EncodeSubmap)->Unit(benchmark::kMicrosecond);

void BM_DecodeSubmap(benchmark::State& state) {
  const std::string bytes = EncodeSubmap(RandomSubmap({})).value_or("");
  for (auto _ : state) benchmark::DoNotOptimize(DecodeSubmap(bytes));
}
BENCHMARK(BM_DecodeSubmap)->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace portolan

int main(int argc, char** argv) {
  portolan::PrintSizes();
  benchmark::Initialize(&argc, argv);
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}
