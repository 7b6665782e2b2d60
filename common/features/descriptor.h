// 256-bit binary descriptors (rotated BRIEF as in ORB, Rublee et al., ICCV 2011).
#ifndef PORTOLAN_COMMON_FEATURES_DESCRIPTOR_H_
#define PORTOLAN_COMMON_FEATURES_DESCRIPTOR_H_

#include <array>
#include <bit>
#include <cstdint>

namespace portolan {

struct Descriptor {
  std::array<uint64_t, 4> words{};

  friend bool operator==(const Descriptor&, const Descriptor&) = default;
};

// Number of bits that differ, 0..256.
inline int HammingDistance(const Descriptor& a, const Descriptor& b) {
  return std::popcount(a.words[0] ^ b.words[0]) + std::popcount(a.words[1] ^ b.words[1]) +
         std::popcount(a.words[2] ^ b.words[2]) + std::popcount(a.words[3] ^ b.words[3]);
}

}  // namespace portolan

#endif  // PORTOLAN_COMMON_FEATURES_DESCRIPTOR_H_
