// The fixed pairs of points that rotated BRIEF compares. Bit i of a descriptor (bit i % 64 of word
// i / 64) is 1 if the image is darker at `a` than at `b`. The pattern is part of the wire format.
#ifndef PORTOLAN_COMMON_FEATURES_BRIEF_PATTERN_H_
#define PORTOLAN_COMMON_FEATURES_BRIEF_PATTERN_H_

#include <array>

namespace portolan {

// Radius in px of the disc that holds all points.
inline constexpr int kBriefRadiusPx = 15;
inline constexpr int kBriefPairs = 256;

// Offsets from the described point in px before the turn by the patch's angle.
struct BriefPair {
  int ax, ay, bx, by;
};

const std::array<BriefPair, kBriefPairs>& BriefPattern();

}  // namespace portolan

#endif  // PORTOLAN_COMMON_FEATURES_BRIEF_PATTERN_H_
