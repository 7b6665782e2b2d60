#include "common/features/rotated_brief.h"

#include <array>
#include <cmath>
#include <cstdint>

#include "common/base/check.h"
#include "common/features/brief_pattern.h"

namespace portolan {
namespace {

constexpr int kRadiusPx = kBriefRadiusPx;

// Half widths of the disc's rows: row v holds the columns -w[v] .. w[v].
std::array<int, kRadiusPx + 1> DiscHalfWidths() {
  std::array<int, kRadiusPx + 1> widths{};
  for (int v = 0; v <= kRadiusPx; ++v) {
    widths[v] = static_cast<int>(std::floor(std::sqrt(kRadiusPx * kRadiusPx - v * v)));
  }
  return widths;
}

}  // namespace

float IntensityCentroidAngle(const cv::Mat& gray, const Eigen::Vector2d& pixel) {
  static const std::array<int, kRadiusPx + 1> kWidths = DiscHalfWidths();
  const int cx = static_cast<int>(std::lround(pixel.x()));
  const int cy = static_cast<int>(std::lround(pixel.y()));
  PORTOLAN_DCHECK(cx >= kRadiusPx && cy >= kRadiusPx && cx + kRadiusPx < gray.cols &&
                  cy + kRadiusPx < gray.rows);
  int m10 = 0, m01 = 0;
  for (int v = -kRadiusPx; v <= kRadiusPx; ++v) {
    const uint8_t* row = gray.ptr<uint8_t>(cy + v) + cx;
    const int width = kWidths[std::abs(v)];
    int row_sum = 0, row_moment = 0;
    for (int u = -width; u <= width; ++u) {
      row_sum += row[u];
      row_moment += u * row[u];
    }
    m10 += row_moment;
    m01 += v * row_sum;
  }
  return std::atan2(static_cast<float>(m01), static_cast<float>(m10));
}

Descriptor DescribeRotatedBrief(const cv::Mat& smoothed, const Eigen::Vector2d& pixel,
                                float angle_rad) {
  struct TestPair {
    float ax, ay, bx, by;
  };
  static const std::array<TestPair, kBriefPairs> kPattern = [] {
    std::array<TestPair, kBriefPairs> pattern{};
    for (int i = 0; i < kBriefPairs; ++i) {
      const BriefPair& pair = BriefPattern()[i];
      pattern[i] = {static_cast<float>(pair.ax), static_cast<float>(pair.ay),
                    static_cast<float>(pair.bx), static_cast<float>(pair.by)};
    }
    return pattern;
  }();
  const float c = std::cos(angle_rad), s = std::sin(angle_rad);
  // The pixel's fraction takes part in the rounding, hence the half pixel.
  const float x0 = static_cast<float>(pixel.x()) + 0.5f;
  const float y0 = static_cast<float>(pixel.y()) + 0.5f;
  const auto sample = [&](float x, float y) {
    const int u = static_cast<int>(x0 + c * x - s * y);
    const int v = static_cast<int>(y0 + s * x + c * y);
    return smoothed.ptr<uint8_t>(v)[u];
  };
  Descriptor descriptor;
  for (int word = 0; word < 4; ++word) {
    uint64_t bits = 0;
    for (int bit = 0; bit < 64; ++bit) {
      const TestPair& pair = kPattern[word * 64 + bit];
      bits |= static_cast<uint64_t>(sample(pair.ax, pair.ay) < sample(pair.bx, pair.by)) << bit;
    }
    descriptor.words[word] = bits;
  }
  return descriptor;
}

}  // namespace portolan
