#include "agent/tracker/response_map.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace portolan {
namespace {

constexpr int kHalfWindow = 3;
constexpr int kWindow = 2 * kHalfWindow + 1;
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
void RowProducts(const int16_t* above, const int16_t* row, const int16_t* below, int width,
                 int32_t* xx, int32_t* xy, int32_t* yy) {
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

// Sums over the window's columns: `in` has kWindow - 1 more columns than `out`.
void AddWindowRow(const int32_t* in, int width, int32_t* out) {
  for (int x = 0; x < width; ++x) {
    out[x] += in[x] + in[x + 1] + in[x + 2] + in[x + 3] + in[x + 4] + in[x + 5] + in[x + 6];
  }
}

void Respond(const int32_t* xx, const int32_t* xy, const int32_t* yy, int width,
             CornerMeasure measure, float* out) {
  constexpr float kUnit = 1.0f / (kWindow * kWindow * kGradientUnit * kGradientUnit);
  for (int x = 0; x < width; ++x) {
    const float a = kUnit * xx[x], b = kUnit * xy[x], c = kUnit * yy[x];
    const float half_trace = 0.5f * (a + c), half_difference = 0.5f * (a - c);
    out[x] = measure == CornerMeasure::kHarris
                 ? a * c - b * b - 0.16f * half_trace * half_trace
                 : half_trace - std::sqrt(half_difference * half_difference + b * b);
  }
}

}  // namespace

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
  Products sums(area.width);
  // Sums over the window of the row are made once per row of products, not once per output row.
  Products rows(static_cast<size_t>(area.width) * product_height);
  for (int y = 0; y < product_height; ++y) {
    const size_t from = static_cast<size_t>(y) * product_width;
    const size_t to = static_cast<size_t>(y) * area.width;
    AddWindowRow(&products.xx[from], area.width, &rows.xx[to]);
    AddWindowRow(&products.xy[from], area.width, &rows.xy[to]);
    AddWindowRow(&products.yy[from], area.width, &rows.yy[to]);
  }
  for (int y = 0; y < product_height; ++y) {
    const size_t added = static_cast<size_t>(y) * area.width;
    for (int x = 0; x < area.width; ++x) {
      sums.xx[x] += rows.xx[added + x];
      sums.xy[x] += rows.xy[added + x];
      sums.yy[x] += rows.yy[added + x];
    }
    if (y < kWindow - 1) continue;
    const size_t removed = static_cast<size_t>(y - kWindow + 1) * area.width;
    Respond(sums.xx.data(), sums.xy.data(), sums.yy.data(), area.width, measure,
            &response[removed]);
    for (int x = 0; x < area.width; ++x) {
      sums.xx[x] -= rows.xx[removed + x];
      sums.xy[x] -= rows.xy[removed + x];
      sums.yy[x] -= rows.yy[removed + x];
    }
  }
  return response;
}

}  // namespace portolan
