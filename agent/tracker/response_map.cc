#include "agent/tracker/response_map.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>

#include "common/base/vector_clones.h"

namespace portolan {
namespace {

constexpr int kHalfWindow = 3;
constexpr float kWindowSum = 16.0f;
// The 3 x 3 Sobel filter's answer to a slope of one grey level per pixel.
constexpr float kGradientUnit = 8.0f;

// Rows are computed in whole vectors of so many, what is too much in the last being left unused.
constexpr int kLanes = 8;

size_t RoundUp(int width) { return static_cast<size_t>(width + kLanes - 1) / kLanes * kLanes; }

// Grey values of `area` grown by `margin`, continued over the image's edge; `stride` a row.
std::unique_ptr<int16_t[]> CopyGrown(const cv::Mat& gray, const cv::Rect& area, int margin,
                                     size_t stride) {
  const int height = area.height + 2 * margin, width = static_cast<int>(stride);
  auto out = std::make_unique_for_overwrite<int16_t[]>(stride * height);
  for (int y = 0; y < height; ++y) {
    const uint8_t* row = gray.ptr<uint8_t>(std::clamp(area.y - margin + y, 0, gray.rows - 1));
    int16_t* to = out.get() + static_cast<size_t>(y) * stride;
    const int x0 = area.x - margin;
    const int first = std::clamp(-x0, 0, width), last = std::clamp(gray.cols - x0, 0, width);
    std::fill(to, to + first, row[0]);
    for (int x = first; x < last; ++x) to[x] = row[x0 + x];
    std::fill(to + last, to + width, row[gray.cols - 1]);
  }
  return out;
}

struct Products {
  explicit Products(size_t size)
      : storage(std::make_unique_for_overwrite<int32_t[]>(3 * size)),
        xx(storage.get()),
        xy(xx + size),
        yy(xy + size) {}
  void ClearLast(size_t size, size_t count) {
    for (int32_t* of : {xx, xy, yy}) std::fill_n(of + size - count, count, 0);
  }

  std::unique_ptr<int32_t[]> storage;
  int32_t *xx, *xy, *yy;
};

// Sobel gradient products of a row of `width` pixels.
PORTOLAN_INLINE void RowProducts(const int16_t* above, const int16_t* row, const int16_t* below,
                                 size_t width, int32_t* xx, int32_t* xy, int32_t* yy) {
  for (size_t x = 0; x < width; ++x) {
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
PORTOLAN_INLINE void AddWindow(const int32_t* in, ptrdiff_t step, size_t width, int32_t* out) {
  for (size_t x = 0; x < width; ++x) {
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
  const int product_height = area.height + 2 * kHalfWindow;
  const size_t width = RoundUp(area.width), product_width = RoundUp(area.width + 2 * kHalfWindow);
  const size_t grown_width = product_width + 2;
  const auto grown = CopyGrown(gray, area, kHalfWindow + 1, grown_width);
  // The last row's vector reads further than the row.
  const size_t product_size = product_width * product_height + kLanes;
  Products products(product_size);
  products.ClearLast(product_size, kLanes);
  for (int y = 0; y < product_height; ++y) {
    const int16_t* above = grown.get() + y * grown_width;
    const size_t at = y * product_width;
    RowProducts(above, above + grown_width, above + 2 * grown_width, product_width,
                products.xx + at, products.xy + at, products.yy + at);
  }
  Products rows(width * product_height);
  for (int y = 0; y < product_height; ++y) {
    const size_t from = y * product_width, to = y * width;
    AddWindow(products.xx + from, 1, width, rows.xx + to);
    AddWindow(products.xy + from, 1, width, rows.xy + to);
    AddWindow(products.yy + from, 1, width, rows.yy + to);
  }
  std::vector<float> response(static_cast<size_t>(area.width) * area.height);
  Products sums(width);
  for (int y = 0; y < area.height; ++y) {
    const size_t at = y * width;
    AddWindow(rows.xx + at, width, width, sums.xx);
    AddWindow(rows.xy + at, width, width, sums.xy);
    AddWindow(rows.yy + at, width, width, sums.yy);
    Respond(sums.xx, sums.xy, sums.yy, area.width, measure,
            &response[static_cast<size_t>(y) * area.width]);
  }
  return response;
}

}  // namespace portolan
