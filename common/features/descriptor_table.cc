#include "common/features/descriptor_table.h"

#include "common/base/check.h"

namespace portolan {
namespace {

struct Words {
  const uint64_t* column[4];
};

constexpr int kIndexBits = 22;

inline __attribute__((always_inline)) uint32_t DistanceAt(const Words& words,
                                                          const Descriptor& query, size_t i) {
  return static_cast<uint32_t>(__builtin_popcountll(words.column[0][i] ^ query.words[0]) +
                               __builtin_popcountll(words.column[1][i] ^ query.words[1]) +
                               __builtin_popcountll(words.column[2][i] ^ query.words[2]) +
                               __builtin_popcountll(words.column[3][i] ^ query.words[3]));
}

inline __attribute__((always_inline)) void FillDistances(const Words& words,
                                                         const Descriptor& query, size_t count,
                                                         uint32_t* out) {
  for (size_t i = 0; i < count; ++i) out[i] = DistanceAt(words, query, i);
}

// Distance and index in one integer, so that the search is a plain minimum.
inline __attribute__((always_inline)) uint32_t FindNearest(const Words& words,
                                                           const Descriptor& query,
                                                           uint32_t count) {
  uint32_t nearest = 257u << kIndexBits;
  for (uint32_t i = 0; i < count; ++i) {
    const uint32_t candidate = (DistanceAt(words, query, i) << kIndexBits) | i;
    nearest = candidate < nearest ? candidate : nearest;
  }
  return nearest;
}

// The loops, compiled once per instruction set. Plain pointers chosen at start, rather than
// ifuncs, because sanitizers do not survive ifuncs.
struct Kernels {
  void (*fill)(const Words&, const Descriptor&, size_t, uint32_t*);
  uint32_t (*nearest)(const Words&, const Descriptor&, uint32_t);
};

#define PORTOLAN_KERNELS(suffix, ...)                                                      \
  __VA_ARGS__ void Fill##suffix(const Words& words, const Descriptor& query, size_t count, \
                                uint32_t* out) {                                           \
    FillDistances(words, query, count, out);                                               \
  }                                                                                        \
  __VA_ARGS__ uint32_t Nearest##suffix(const Words& words, const Descriptor& query,        \
                                       uint32_t count) {                                   \
    return FindNearest(words, query, count);                                               \
  }

PORTOLAN_KERNELS(Portable)

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
PORTOLAN_KERNELS(Popcnt, __attribute__((target("popcnt"), optimize("O3"))))
PORTOLAN_KERNELS(Avx512,
                 __attribute__((target("avx512f,avx512vl,avx512vpopcntdq,prefer-vector-width=512"),
                                optimize("O3"))))

Kernels ChooseKernels() {
  __builtin_cpu_init();
  if (__builtin_cpu_supports("avx512vpopcntdq") && __builtin_cpu_supports("avx512vl")) {
    return {FillAvx512, NearestAvx512};
  }
  if (__builtin_cpu_supports("popcnt")) return {FillPopcnt, NearestPopcnt};
  return {FillPortable, NearestPortable};
}
#else
Kernels ChooseKernels() { return {FillPortable, NearestPortable}; }
#endif

#undef PORTOLAN_KERNELS

const Kernels& ChosenKernels() {
  static const Kernels kKernels = ChooseKernels();
  return kKernels;
}

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
  distances_bits->resize(size());
  const Words words = {{words_[0].data(), words_[1].data(), words_[2].data(), words_[3].data()}};
  ChosenKernels().fill(words, query, size(), distances_bits->data());
}

DescriptorTable::Neighbour DescriptorTable::Nearest(const Descriptor& query) const {
  PORTOLAN_CHECK(size() <= (size_t{1} << kIndexBits));
  const Words words = {{words_[0].data(), words_[1].data(), words_[2].data(), words_[3].data()}};
  const uint32_t nearest = ChosenKernels().nearest(words, query, static_cast<uint32_t>(size()));
  return {nearest >> kIndexBits, nearest & ((1u << kIndexBits) - 1)};
}

}  // namespace portolan
