#include "common/features/brief_pattern.h"

#include <cmath>
#include <cstdint>

namespace portolan {
namespace {

// A fixed generator, so that the pattern is the same with every compiler and for ever: it is part
// of the wire format (Knuth's MMIX constants).
class PatternGenerator {
 public:
  double Uniform() {
    state_ = state_ * 6364136223846793005ull + 1442695040888963407ull;
    return static_cast<double>(state_ >> 40) / static_cast<double>(1u << 24);
  }
  // Sum of 12 uniform numbers: normal enough, and exact arithmetic everywhere.
  double Normal() {
    double sum = -6.0;
    for (int i = 0; i < 12; ++i) sum += Uniform();
    return sum;
  }

 private:
  uint64_t state_ = 20081108;
};

// BRIEF's pattern "G II": both points isotropic Gaussian, here with sigma = radius / 2.5, inside
// the disc, at least 3 px apart so that a comparison means something after smoothing.
std::array<BriefPair, kBriefPairs> MakePattern() {
  std::array<BriefPair, kBriefPairs> pattern{};
  PatternGenerator generator;
  const double sigma = kBriefRadiusPx / 2.5;
  const auto point = [&](int* x, int* y) {
    double px = 0.0, py = 0.0;
    do {
      px = std::round(sigma * generator.Normal());
      py = std::round(sigma * generator.Normal());
    } while (px * px + py * py > kBriefRadiusPx * kBriefRadiusPx);
    *x = static_cast<int>(px);
    *y = static_cast<int>(py);
  };
  for (BriefPair& pair : pattern) {
    do {
      point(&pair.ax, &pair.ay);
      point(&pair.bx, &pair.by);
    } while ((pair.ax - pair.bx) * (pair.ax - pair.bx) + (pair.ay - pair.by) * (pair.ay - pair.by) <
             9);
  }
  return pattern;
}

}  // namespace

const std::array<BriefPair, kBriefPairs>& BriefPattern() {
  static const std::array<BriefPair, kBriefPairs> kPattern = MakePattern();
  return kPattern;
}

}  // namespace portolan
