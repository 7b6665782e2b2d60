#include "common/features/descriptor_table.h"

namespace portolan {
namespace {

struct Words {
  const uint64_t* column[4];
};

using DistanceLoop = void (*)(const Words&, const Descriptor&, size_t, uint32_t*);

// The same loop, compiled once per instruction set. A plain pointer chosen at start, rather than
// an ifunc, because sanitizers do not survive ifuncs.
#define PORTOLAN_DISTANCE_LOOP_BODY                                                            \
  for (size_t i = 0; i < count; ++i) {                                                         \
    out[i] = static_cast<uint32_t>(__builtin_popcountll(words.column[0][i] ^ query.words[0]) + \
                                   __builtin_popcountll(words.column[1][i] ^ query.words[1]) + \
                                   __builtin_popcountll(words.column[2][i] ^ query.words[2]) + \
                                   __builtin_popcountll(words.column[3][i] ^ query.words[3])); \
  }

void DistancesPortable(const Words& words, const Descriptor& query, size_t count, uint32_t* out) {
  PORTOLAN_DISTANCE_LOOP_BODY
}

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
__attribute__((target("popcnt"), optimize("O3"))) void DistancesPopcnt(const Words& words,
                                                                       const Descriptor& query,
                                                                       size_t count,
                                                                       uint32_t* out) {
  PORTOLAN_DISTANCE_LOOP_BODY
}

__attribute__((target("avx512f,avx512vl,avx512vpopcntdq,prefer-vector-width=512"),
               optimize("O3"))) void
DistancesAvx512(const Words& words, const Descriptor& query, size_t count,
                uint32_t* out){PORTOLAN_DISTANCE_LOOP_BODY}

DistanceLoop ChooseLoop() {
  __builtin_cpu_init();
  if (__builtin_cpu_supports("avx512vpopcntdq") && __builtin_cpu_supports("avx512vl")) {
    return DistancesAvx512;
  }
  return __builtin_cpu_supports("popcnt") ? DistancesPopcnt : DistancesPortable;
}
#else
DistanceLoop ChooseLoop() { return DistancesPortable; }
#endif

#undef PORTOLAN_DISTANCE_LOOP_BODY

}  // namespace

void DescriptorTable::Reserve(size_t count) {
  for (auto& column : words_) column.reserve(count);
}

void DescriptorTable::Append(const Descriptor& descriptor) {
  for (size_t w = 0; w < 4; ++w) words_[w].push_back(descriptor.words[w]);
}

Descriptor DescriptorTable::operator[](size_t index) const {
  return {{words_[0][index], words_[1][index], words_[2][index], words_[3][index]}};
}

void DescriptorTable::Distances(const Descriptor& query,
                                std::vector<uint32_t>* distances_bits) const {
  static const DistanceLoop kLoop = ChooseLoop();
  distances_bits->resize(size());
  const Words words = {{words_[0].data(), words_[1].data(), words_[2].data(), words_[3].data()}};
  kLoop(words, query, size(), distances_bits->data());
}

}  // namespace portolan
