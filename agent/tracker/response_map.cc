#include "agent/tracker/response_map.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "common/base/vector_clones.h"

namespace portolan {
namespace {

constexpr int kHalfWindow = 3;
constexpr float kWindowSum = 16.0f;
// The 3 x 3 Sobel filter's answer to a slope of one grey level per pixel.
constexpr float kGradientUnit = 8.0f;

// Grey values of `area` grown by `margin`, continued over the image's edge.
std::vector<int16_t> CopyGrown(const cv::Mat& gray, const cv::Rect& area, int margin) {
  const int width = area.width + 2 * margin, height = area.height + 2 * margin;
  std::vector<int16_t> out(static_cast<size_t>(width) * height);
  for (int y = 0; y < height; ++y) {
    const uint8_t* row = gray.ptr<uint8_t>(std::clamp(area.y - margin + y, 0, gray.rows - 1));
    int16_t* to = out.data() + static_cast<size_t>(y) * width;
    const int x0 = area.x - margin;
    const int first = std::clamp(-x0, 0, width), last = std::clamp(gray.cols - x0, 0, width);
    std::fill(to, to + first, row[0]);
    for (int x = first; x < last; ++x) to[x] = row[x0 + x];
    std::fill(to + last, to + width, row[gray.cols - 1]);
  }
  return out;
}

struct Products {
  std::vector<int32_t> xx, xy, yy;
  explicit Products(size_t size) : xx(size), xy(size), yy(size) {}
};

// Sobel gradient products of a row of `width` pixels.
PORTOLAN_INLINE void RowProducts(const int16_t* above, const int16_t* row, const int16_t* below,
                                 int width, int32_t* xx, int32_t* xy, int32_t* yy) {
  for (int x = 0; x < width; ++x) {
    // 16 bits on purpose: every vector unit multiplies these, but not 32-bit integers.
    const int16_t gx =
        (above[x + 2] + 2 * row[x + 2] + below[x + 2]) - (above[x] + 2 * row[x] + below[x]);
    const int16_t gy =
        (below[x] + 2 * below[x + 1] + below[x + 2]) - (above[x] + 2 * above[x + 1] + above[x + 2]);
    xx[x] = gx * gx;
    xy[x] = gx * gy;
    yy[x] = gy * gy;
  }
}

// The window is a triangle, 1 2 3 4 3 2 1 in each direction: with equal weights the response has
// plateaus and its maxima jump about. `step` is the distance of successive window elements.
PORTOLAN_INLINE void AddWindow(const int32_t* in, ptrdiff_t step, int width, int32_t* out) {
  for (int x = 0; x < width; ++x) {
    const int32_t* p = in + x;
    const int32_t inner = p[2 * step] + p[3 * step] + p[4 * step];
    const int32_t middle = p[step] + p[5 * step] + inner;
    out[x] = p[0] + p[6 * step] + 2 * middle + inner + p[3 * step];
  }
}

PORTOLAN_INLINE void Respond(const int32_t* xx, const int32_t* xy, const int32_t* yy, int width,
                             CornerMeasure measure, float* out) {
  constexpr float kUnit = 1.0f / (kWindowSum * kWindowSum * kGradientUnit * kGradientUnit);
  for (int x = 0; x < width; ++x) {
    const float a = kUnit * xx[x], b = kUnit * xy[x], c = kUnit * yy[x];
    const float trace = a + c, determinant = a * c - b * b;
    out[x] = measure == CornerMeasure::kHarris ? determinant - 0.04f * trace * trace
                                               : determinant / (trace + 1e-6f);
  }
}

}  // namespace

PORTOLAN_VECTOR_CLONES
std::vector<float> ComputeResponse(const cv::Mat& gray, const cv::Rect& area,
                                   CornerMeasure measure) {
  const int grown_width = area.width + 2 * (kHalfWindow + 1);
  const int product_width = area.width + 2 * kHalfWindow;
  const int product_height = area.height + 2 * kHalfWindow;
  const std::vector<int16_t> grown = CopyGrown(gray, area, kHalfWindow + 1);
  Products products(static_cast<size_t>(product_width) * product_height);
  for (int y = 0; y < product_height; ++y) {
    const int16_t* above = grown.data() + static_cast<size_t>(y) * grown_width;
    const size_t at = static_cast<size_t>(y) * product_width;
    RowProducts(above, above + grown_width, above + 2 * grown_width, product_width,
                &products.xx[at], &products.xy[at], &products.yy[at]);
  }
  std::vector<float> response(static_cast<size_t>(area.width) * area.height);
  Products rows(static_cast<size_t>(area.width) * product_height);
  for (int y = 0; y < product_height; ++y) {
    const size_t from = static_cast<size_t>(y) * product_width;
    const size_t to = static_cast<size_t>(y) * area.width;
    AddWindow(&products.xx[from], 1, area.width, &rows.xx[to]);
    AddWindow(&products.xy[from], 1, area.width, &rows.xy[to]);
    AddWindow(&products.yy[from], 1, area.width, &rows.yy[to]);
  }
  Products sums(area.width);
  for (int y = 0; y < area.height; ++y) {
    const size_t at = static_cast<size_t>(y) * area.width;
    AddWindow(&rows.xx[at], area.width, area.width, sums.xx.data());
    AddWindow(&rows.xy[at], area.width, area.width, sums.xy.data());
    AddWindow(&rows.yy[at], area.width, area.width, sums.yy.data());
    Respond(sums.xx.data(), sums.xy.data(), sums.yy.data(), area.width, measure, &response[at]);
  }
  return response;
}

}  // namespace portolan
