// CPU time of one verification, for a pair that shows the same place and one that does not.
#include <benchmark/benchmark.h>

#include "common/base/check.h"
#include "server/verification/verifier.h"
#include "tests/server/verification/synthetic_pair.h"

namespace portolan {
namespace {

SyntheticPairOptions Options(uint32_t seed) {
  SyntheticPairOptions options;
  options.seed = seed;
  options.points = 350;
  options.private_points = 250;
  options.noise_bits = 25;
  return options;
}

void Run(const RefinedSubmap& a, const RefinedSubmap& b, benchmark::State& state) {
  const auto verifier = Verifier::Create({});
  PORTOLAN_CHECK(verifier.ok());
  bool accepted = false;
  for (auto _ : state) accepted = verifier->Verify(a, b).has_value();
  state.counters["accepted"] = accepted;
}

void BM_VerifySamePlace(benchmark::State& state) {
  const SyntheticPair pair = MakeSyntheticPair(Options(1));
  Run(pair.a, pair.b, state);
}
BENCHMARK(BM_VerifySamePlace)->Unit(benchmark::kMillisecond);

void BM_VerifyOtherPlace(benchmark::State& state) {
  Run(MakeSyntheticPair(Options(1)).a, MakeSyntheticPair(Options(2)).b, state);
}
BENCHMARK(BM_VerifyOtherPlace)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace portolan

BENCHMARK_MAIN();
