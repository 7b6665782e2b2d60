#include "agent/tracker/patch_flow.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>

#include "common/base/vector_clones.h"

namespace portolan {
namespace {

// The window is kSize x kSize pixels, from -kBefore to kSize - 1 - kBefore about the point.
constexpr int kSize = 12;
constexpr int kBefore = 6;
constexpr int kArea = kSize * kSize;
// Rows as they are stored and multiplied, zero beyond the window: whole vectors.
constexpr int kRow = 16;
constexpr int kStored = kSize * kRow;
static_assert(kRow - kSize <= kPyramidSlackPx, "rows are read this far beyond the padding");
constexpr int kMaxIterations = 8;
constexpr float kConvergedPx = 0.03f;
// Least mean squared gradient in the weaker direction, (grey levels/px)^2.
constexpr float kMinEigenvalue = 0.5f;

// Samples are grey levels times 4: two binary digits keep all sums of products within 32 bits.
constexpr int kWeightBits = 5;
constexpr int kSampleShift = 2 * kWeightBits - 2;

// Starts are compared at this level: coarse enough for errors of several pixels.
constexpr int kStartLevel = 2;

// Small enough for the fixed-point lattice.
bool IsSane(const Eigen::Vector2f& pixel) {
  return pixel.allFinite() && pixel.cwiseAbs().maxCoeff() < 1e5f;
}

struct Lattice {
  int x, y;    // top left pixel
  int wx, wy;  // fractions in units of 2^-kWeightBits
};

Lattice LatticeAt(const Eigen::Vector2f& pixel, int before) {
  constexpr int kOne = 1 << kWeightBits;
  const int x = static_cast<int>(std::lround(pixel.x() * kOne));
  const int y = static_cast<int>(std::lround(pixel.y() * kOne));
  return {(x >> kWeightBits) - before, (y >> kWeightBits) - before, x & (kOne - 1), y & (kOne - 1)};
}

// Bilinear samples of an N x N window whose fraction is the same for all pixels, in rows of kRow.
// First along the rows, then between them. All within 16 bits: the row sums are split in quotient
// and remainder, of which the weights' sum, 2^kWeightBits, makes no more.
template <int N>
PORTOLAN_INLINE bool Sample(const PyramidLevel& level, const Lattice& at, int16_t* out) {
  if (!level.Holds(at.x, at.y, at.x + N, at.y + N)) return false;
  constexpr int16_t kOne = 1 << kWeightBits;
  constexpr int16_t kHalf = 1 << (kSampleShift - 1);
  constexpr int kLowBits = kSampleShift - kWeightBits;
  constexpr int16_t kLow = (1 << kLowBits) - 1;
  const int16_t wx = static_cast<int16_t>(at.wx);
  const int16_t below = static_cast<int16_t>(at.wy), above = static_cast<int16_t>(kOne - at.wy);
  constexpr Short16 kColumn = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
  const Short16 inside = kColumn < static_cast<int16_t>(N);
  const Short16 right = inside & wx, left = (inside & kOne) - right;
  Short16 high_above = {}, low_above = {};
  for (int v = 0; v <= N; ++v) {
    Byte16 pixels, next_pixels;
    const uint8_t* row = level.At(at.x, at.y + v);
    std::memcpy(&pixels, row, sizeof(pixels));
    std::memcpy(&next_pixels, row + 1, sizeof(next_pixels));
    const Short16 sum = left * __builtin_convertvector(pixels, Short16) +
                        right * __builtin_convertvector(next_pixels, Short16);
    const Short16 high = sum >> kLowBits, low = sum & kLow;
    if (v > 0) {
      const Short16 rest = (above * low_above + below * low + kHalf) >> kLowBits;
      const Short16 sample = (above * high_above + below * high + rest) >> kWeightBits;
      std::memcpy(out + (v - 1) * kRow, &sample, sizeof(sample));
    }
    high_above = high;
    low_above = low;
  }
  return true;
}

struct Template {
  int16_t value[kStored];
  int16_t gx[kStored];  // central differences: 8 times the gradient per pixel
  int16_t gy[kStored];
  int sum_gx = 0, sum_gy = 0;
  // Inverse of the 2x2 matrix of the gradient products, mean-free.
  float inverse_xx = 0, inverse_xy = 0, inverse_yy = 0;
};

// One within the window. Sums of plain numbers are products with it, which vectors have an
// instruction for.
constexpr auto kInside = [] {
  std::array<int16_t, kStored> inside{};
  for (int i = 0; i < kStored; ++i) inside[i] = i % kRow < kSize ? 1 : 0;
  return inside;
}();

PORTOLAN_INLINE bool MakeTemplate(const PyramidLevel& level, const Eigen::Vector2f& pixel,
                                  Template* t) {
  constexpr int kGrown = kSize + 2;
  int16_t grown[kGrown * kRow + 2] = {};  // one more, which is read for nothing
  if (!Sample<kGrown>(level, LatticeAt(pixel, kBefore + 1), grown)) return false;
  for (int v = 0; v < kSize; ++v) {
    const int16_t* row = grown + (v + 1) * kRow + 1;
    Short16 inside, here, left, right, above, below;
    std::memcpy(&inside, kInside.data(), sizeof(inside));
    std::memcpy(&here, row, sizeof(here));
    std::memcpy(&left, row - 1, sizeof(left));
    std::memcpy(&right, row + 1, sizeof(right));
    std::memcpy(&above, row - kRow, sizeof(above));
    std::memcpy(&below, row + kRow, sizeof(below));
    const Short16 value = inside * here, gx = inside * (right - left),
                  gy = inside * (below - above);
    std::memcpy(t->value + v * kRow, &value, sizeof(value));
    std::memcpy(t->gx + v * kRow, &gx, sizeof(gx));
    std::memcpy(t->gy + v * kRow, &gy, sizeof(gy));
  }
  int xx = 0, xy = 0, yy = 0, sx = 0, sy = 0;
  for (int i = 0; i < kStored; ++i) {
    xx += t->gx[i] * t->gx[i];
    xy += t->gx[i] * t->gy[i];
    yy += t->gy[i] * t->gy[i];
    sx += t->gx[i] * kInside[i];
    sy += t->gy[i] * kInside[i];
  }
  t->sum_gx = sx;
  t->sum_gy = sy;
  const float fxx = xx - static_cast<float>(sx) * sx / kArea;
  const float fxy = xy - static_cast<float>(sx) * sy / kArea;
  const float fyy = yy - static_cast<float>(sy) * sy / kArea;
  const float min_eigenvalue = 0.5f * (fxx + fyy - std::hypot(fxx - fyy, 2.0f * fxy));
  if (min_eigenvalue < kMinEigenvalue * 64.0f * kArea) return false;
  const float scale = 1.0f / (fxx * fyy - fxy * fxy);
  t->inverse_xx = fyy * scale;
  t->inverse_xy = -fxy * scale;
  t->inverse_yy = fxx * scale;
  return true;
}

struct Residual {
  float bx = 0, by = 0;  // gradient times mean-free difference
  float energy = 0;      // sum of squares of the mean-free difference
};

PORTOLAN_INLINE bool Evaluate(const PyramidLevel& level, const Template& t,
                              const Eigen::Vector2f& pixel, Residual* residual) {
  int16_t window[kStored];
  if (!Sample<kSize>(level, LatticeAt(pixel, kBefore), window)) return false;
  int sum = 0, bx = 0, by = 0, squares = 0;
  for (int i = 0; i < kStored; ++i) {
    const int16_t difference = static_cast<int16_t>(window[i] - t.value[i]);
    sum += difference * kInside[i];
    bx += difference * t.gx[i];
    by += difference * t.gy[i];
    squares += difference * difference;
  }
  const float mean = static_cast<float>(sum) / kArea;
  residual->bx = bx - mean * t.sum_gx;
  residual->by = by - mean * t.sum_gy;
  residual->energy = squares - mean * sum;
  return true;
}

// One level; `pixel` holds the start and then the result. False if it could not be improved.
PORTOLAN_VECTOR_CLONES bool TrackLevel(const PyramidLevel& from, const PyramidLevel& to,
                                       const Eigen::Vector2f& origin, Eigen::Vector2f* pixel) {
  Template t;
  if (!MakeTemplate(from, origin, &t)) return false;
  Eigen::Vector2f at = *pixel;
  Residual residual;
  if (!Evaluate(to, t, at, &residual)) return false;
  const float start_energy = residual.energy;
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    // Differences of samples are 4 times grey levels and gradients 8 times: the step is doubled.
    const Eigen::Vector2f step =
        2.0f * Eigen::Vector2f(t.inverse_xx * residual.bx + t.inverse_xy * residual.by,
                               t.inverse_xy * residual.bx + t.inverse_yy * residual.by);
    at -= step;
    if (!IsSane(at) || !Evaluate(to, t, at, &residual)) return false;
    if (step.squaredNorm() < kConvergedPx * kConvergedPx) break;
  }
  if (residual.energy > start_energy) return false;
  *pixel = at;
  return true;
}

// The start with the least residual at one level.
PORTOLAN_VECTOR_CLONES Eigen::Vector2f BestStart(const PyramidLevel& from, const PyramidLevel& to,
                                                 float scale, const Eigen::Vector2f& origin,
                                                 std::span<const Eigen::Vector2d> starts) {
  Eigen::Vector2f best = starts.front().cast<float>();
  Template t;
  if (starts.size() == 1 || !MakeTemplate(from, origin * scale, &t)) return best;
  float best_energy = std::numeric_limits<float>::max();
  for (const Eigen::Vector2d& start : starts) {
    Residual residual;
    const Eigen::Vector2f at = start.cast<float>() * scale;
    if (IsSane(at) && Evaluate(to, t, at, &residual) && residual.energy < best_energy) {
      best_energy = residual.energy;
      best = start.cast<float>();
    }
  }
  return best;
}

}  // namespace

std::optional<Eigen::Vector2d> TrackTranslation(const ImagePyramid& from, const ImagePyramid& to,
                                                const Eigen::Vector2d& pixel_in_from,
                                                std::span<const Eigen::Vector2d> starts_in_to,
                                                int last_level) {
  const int top = std::min(from.num_levels(), to.num_levels()) - 1;
  if (top < 0 || starts_in_to.empty()) return std::nullopt;
  const Eigen::Vector2f origin = pixel_in_from.cast<float>();
  const int middle = std::min(kStartLevel, top);
  Eigen::Vector2f pixel =
      BestStart(from.Level(middle), to.Level(middle), 1.0f / (1 << middle), origin, starts_in_to);
  if (!IsSane(pixel) || !IsSane(origin)) return std::nullopt;
  bool any = false;
  for (int level = top; level >= std::min(last_level, top); --level) {
    const float scale = 1.0f / static_cast<float>(1 << level);
    Eigen::Vector2f at = pixel * scale;
    if (TrackLevel(from.Level(level), to.Level(level), origin * scale, &at)) {
      pixel = at / scale;
      any = true;
    }
  }
  if (!any) return std::nullopt;
  return pixel.cast<double>();
}

}  // namespace portolan
