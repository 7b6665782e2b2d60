// Time of adding to and querying the place index by its size. The descriptors are synthetic: bits
// are signs of a few shared normal factors plus a bias and noise, fitted so that the distances
// between unrelated descriptors (mean 100 of 256 bits, standard deviation 26) and the chance that
// they share a word of 16 or 20 bits (0.0036, 0.0012) are those of rotated BRIEF on real images.
#include <benchmark/benchmark.h>

#include <array>
#include <cmath>
#include <map>
#include <memory>
#include <random>

#include "common/base/check.h"
#include "server/place_recognition/place_index.h"

namespace portolan {
namespace {

constexpr int kFeatures = 700;  // two described keyframes

class DescriptorSource {
 public:
  explicit DescriptorSource(uint64_t seed) : random_(seed) {}

  Descriptor Next() {
    static const Model& model = *new Model();
    std::array<float, kFactors> factors;
    for (float& factor : factors) factor = normal_(random_);
    Descriptor descriptor;
    for (size_t bit = 0; bit < 256; ++bit) {
      float value = model.bias[bit] + 0.5f * normal_(random_);
      for (size_t k = 0; k < kFactors; ++k) value += model.loading[bit][k] * factors[k];
      if (value > 0) descriptor.words[bit / 64] |= uint64_t{1} << (bit % 64);
    }
    return descriptor;
  }

  Descriptor Flip(Descriptor descriptor, int bits) {
    for (int i = 0; i < bits; ++i) {
      const uint64_t bit = random_() % 256;
      descriptor.words[bit / 64] ^= uint64_t{1} << (bit % 64);
    }
    return descriptor;
  }

 private:
  static constexpr size_t kFactors = 4;

  struct Model {
    Model() {
      std::mt19937_64 random(1);
      std::normal_distribution<float> normal;
      for (size_t bit = 0; bit < 256; ++bit) {
        float squares = 0;
        for (float& loading : loading[bit]) {
          loading = normal(random);
          squares += loading * loading;
        }
        for (float& loading : loading[bit]) loading /= std::sqrt(squares);
        bias[bit] = 0.8f * normal(random);
      }
    }
    std::array<std::array<float, kFactors>, 256> loading;
    std::array<float, 256> bias;
  };

  std::mt19937_64 random_;
  std::normal_distribution<float> normal_;
};

Submap MakePlace(uint64_t seed) {
  DescriptorSource source(seed);
  Submap submap;
  submap.keyframes.resize(1);
  for (int i = 0; i < kFeatures; ++i) {
    Feature feature;
    if (i % 3 != 0) feature.track = TrackId(i / 3);
    feature.descriptor = source.Next();
    submap.keyframes[0].features.push_back(feature);
  }
  return submap;
}

Submap Revisit(uint64_t seed) {
  Submap submap = MakePlace(seed);
  DescriptorSource noise(seed + 1000000);
  for (size_t i = 0; i < submap.keyframes[0].features.size(); ++i) {
    Descriptor& descriptor = submap.keyframes[0].features[i].descriptor;
    descriptor = i % 3 == 0 ? noise.Flip(descriptor, 40) : noise.Next();
  }
  return submap;
}

std::shared_ptr<const Submap> Shared(Submap submap) {
  return std::make_shared<const Submap>(std::move(submap));
}

// Indices are made once a size, since filling the largest takes longer than measuring.
PlaceIndex& IndexOf(int size) {
  static std::map<int, std::unique_ptr<PlaceIndex>>& indices =
      *new std::map<int, std::unique_ptr<PlaceIndex>>();
  std::unique_ptr<PlaceIndex>& index = indices[size];
  if (!index) {
    auto created = PlaceIndex::Create({});
    PORTOLAN_CHECK(created.ok());
    index = *std::move(created);
    for (int i = 0; i < size; ++i) index->Add(SubmapId(i), Shared(MakePlace(i)));
  }
  return *index;
}

void BM_PlaceIndexQuery(benchmark::State& state) {
  const int size = static_cast<int>(state.range(0));
  const PlaceIndex& index = IndexOf(size);
  std::vector<Submap> queries;
  for (int i = 0; i < 20; ++i) queries.push_back(Revisit(i * size / 20));
  int next = 0, found = 0, asked = 0;
  for (auto _ : state) {
    const int i = next++ % 20;
    const auto candidates = index.Query(queries[i], 5, {});
    ++asked;
    for (const PlaceCandidate& candidate : candidates) {
      found += candidate.submap == SubmapId(i * size / 20);
    }
  }
  state.counters["recall_at_5"] = static_cast<double>(found) / asked;
}
BENCHMARK(BM_PlaceIndexQuery)->Arg(100)->Arg(1000)->Arg(10000)->Unit(benchmark::kMillisecond);

void BM_PlaceIndexAddRemove(benchmark::State& state) {
  const int size = static_cast<int>(state.range(0));
  PlaceIndex& index = IndexOf(size);
  const auto place = Shared(MakePlace(123456));
  for (auto _ : state) {
    index.Add(SubmapId(size), place);
    index.Remove(SubmapId(size));
  }
}
BENCHMARK(BM_PlaceIndexAddRemove)->Arg(100)->Arg(1000)->Arg(10000)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace portolan

BENCHMARK_MAIN();
