#include "agent/tracker/patch_search.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <vector>

#include "common/base/vector_clones.h"

namespace portolan {
namespace {

constexpr int kHalf = 4;
constexpr int kSide = 2 * kHalf + 1;
constexpr int kArea = kSide * kSide;
// Rows of the window as they are stored and multiplied, zero beyond kSide: whole vectors.
constexpr int kRow = 16;
static_assert(kRow - kHalf <= kPyramidPaddingPx, "rows are read this far beyond the pixel");
// Places worth an alignment: their number, and the correlation before it.
constexpr size_t kMaxCandidates = 4;
constexpr float kMinCandidateCorrelation = 0.5f;
constexpr double kSeparationPx = 3.0;

// The patch as it should look in the image, mean-free, in units of 1/8 grey level.
struct Window {
  int16_t value[kSide * kRow] = {};
  float energy = 0.0f;
};

std::optional<Window> MakeWindow(const ReferencePatch& reference,
                                 const Eigen::Matrix2d& patch_from_window) {
  Eigen::Array<float, kArea, 1> values;
  for (int i = 0; i < kArea; ++i) {
    const Eigen::Vector2d at(i % kSide - kHalf, i / kSide - kHalf);
    values[i] = reference.Interpolate(patch_from_window * at);
  }
  values -= values.mean();
  Window window;
  for (int i = 0; i < kArea; ++i) {
    const int16_t value = static_cast<int16_t>(std::lround(8.0f * values[i]));
    window.value[i / kSide * kRow + i % kSide] = value;
    window.energy += static_cast<float>(value) * value;
  }
  if (window.energy < 64.0f * kArea) return std::nullopt;
  return window;
}

// Sums of plain numbers are products with these, which vectors have an instruction for.
constexpr auto kOnes = [] {
  std::array<int16_t, kSide * kRow> ones{};
  for (int i = 0; i < kSide * kRow; ++i) ones[i] = i % kRow < kSide ? 1 : 0;
  return ones;
}();

// The window is mean-free up to rounding, so the image's mean drops out of the product.
PORTOLAN_INLINE float CorrelationAt(const PyramidLevel& level, const Window& window, int x, int y) {
  constexpr Short16 kInside = {1, 1, 1, 1, 1, 1, 1, 1, 1};
  int16_t values[kSide * kRow];
  for (int v = 0; v < kSide; ++v) {
    Byte16 pixels;
    std::memcpy(&pixels, level.At(x - kHalf, y + v - kHalf), sizeof(pixels));
    const Short16 row = __builtin_convertvector(pixels, Short16) * kInside;
    std::memcpy(values + v * kRow, &row, sizeof(row));
  }
  int sum = 0, squares = 0, product = 0;
  for (int i = 0; i < kSide * kRow; ++i) {
    sum += values[i] * kOnes[i];
    squares += values[i] * values[i];
    product += values[i] * window.value[i];
  }
  const float energy = squares - static_cast<float>(sum) * sum / kArea;
  if (energy < static_cast<float>(kArea)) return 0.0f;
  return product / std::sqrt(energy * window.energy);
}

struct Candidate {
  float correlation;
  int x, y;
};

// Best first, at least kSeparationPx apart.
std::vector<Candidate> BestSeparated(std::vector<Candidate> all) {
  std::sort(all.begin(), all.end(), [](const Candidate& a, const Candidate& b) {
    if (a.correlation != b.correlation) return a.correlation > b.correlation;
    return a.y != b.y ? a.y < b.y : a.x < b.x;
  });
  std::vector<Candidate> best;
  for (const Candidate& c : all) {
    const bool near = std::any_of(best.begin(), best.end(), [&](const Candidate& other) {
      return std::hypot(c.x - other.x, c.y - other.y) < kSeparationPx;
    });
    if (!near) best.push_back(c);
    if (best.size() == kMaxCandidates) break;
  }
  return best;
}

PORTOLAN_VECTOR_CLONES
std::vector<Candidate> Scan(const PyramidLevel& level, const Window& window,
                            const Eigen::Vector2d& centre, const Eigen::Matrix2d& covariance,
                            double max_radius) {
  const Eigen::Matrix2d information = covariance.inverse();
  const int reach_x = std::ceil(std::min(max_radius, 3.0 * std::sqrt(covariance(0, 0))));
  const int reach_y = std::ceil(std::min(max_radius, 3.0 * std::sqrt(covariance(1, 1))));
  const int cx = static_cast<int>(std::lround(centre.x()));
  const int cy = static_cast<int>(std::lround(centre.y()));
  std::vector<Candidate> candidates;
  for (int y = std::max(kHalf, cy - reach_y);
       y <= std::min(level.height_px - 1 - kHalf, cy + reach_y); ++y) {
    for (int x = std::max(kHalf, cx - reach_x);
         x <= std::min(level.width_px - 1 - kHalf, cx + reach_x); ++x) {
      const Eigen::Vector2d offset = Eigen::Vector2d(x, y) - centre;
      // Half a pixel of slack keeps the centre of a tiny ellipse in.
      if (offset.dot(information * offset) > 9.0 && offset.squaredNorm() > 1.0) continue;
      const float correlation = CorrelationAt(level, window, x, y);
      if (correlation > kMinCandidateCorrelation) candidates.push_back({correlation, x, y});
    }
  }
  return BestSeparated(std::move(candidates));
}

bool IsPositive(const Eigen::Matrix2d& covariance) {
  return covariance.allFinite() && covariance(0, 0) > 0.0 && covariance(1, 1) > 0.0 &&
         covariance.determinant() > 1e-9;
}

}  // namespace

std::optional<PatchAlignment> SearchPatch(const ImagePyramid& image,
                                          const ReferencePatch& reference,
                                          const PatchPose& expected,
                                          const Eigen::Matrix2d& covariance_px2,
                                          const PatchSearchOptions& options) {
  if (!IsSound(expected) || expected.pixel.cwiseAbs().maxCoeff() > 1e6) return std::nullopt;
  if (!IsPositive(covariance_px2)) return std::nullopt;
  const int level_index = PatchLevel(expected, image.num_levels());
  const double scale = 1.0 / (1 << level_index);
  const auto window = MakeWindow(reference, (expected.affine * scale).inverse());
  if (!window) return std::nullopt;
  std::optional<PatchAlignment> best;
  double second = -1.0;
  for (const Candidate& c : Scan(image.Level(level_index), *window, expected.pixel * scale,
                                 covariance_px2 * scale * scale, options.max_radius_px * scale)) {
    const Eigen::Vector2d pixel = Eigen::Vector2d(c.x, c.y) / scale;
    const auto aligned = reference.Align(image, {pixel, expected.affine});
    if (!aligned) continue;
    if (best && (aligned->pose.pixel - best->pose.pixel).norm() < kSeparationPx) continue;
    if (!best || aligned->correlation > best->correlation) {
      if (best) second = std::max(second, best->correlation);
      best = aligned;
    } else {
      second = std::max(second, aligned->correlation);
    }
  }
  if (!best || best->correlation < options.min_correlation) return std::nullopt;
  if (best->correlation - second < options.min_lead) return std::nullopt;
  return best;
}

}  // namespace portolan
