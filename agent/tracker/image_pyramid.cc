#include "agent/tracker/image_pyramid.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "common/base/vector_clones.h"

namespace portolan {
namespace {

constexpr int kSmallestSidePx = 16;

// Results that are computed at once, from twice as many pixels.
constexpr int kLanes = 16;

// Index of a pixel beyond the edge, mirrored about the last one.
int Mirrored(int index, int size) {
  if (index < 0) return -index;
  return index < size ? index : 2 * (size - 1) - index;
}

// Sums of a row of `width` pixels, weighted 1 4 6 4 1 about every second of them. Those at the ends
// that `row` has no neighbours for are computed singly; `sums` has room for kLanes more.
PORTOLAN_INLINE void AddAlongRow(const uint8_t* row, int width, uint16_t* sums) {
  const int count = (width + 1) / 2;
  for (int x = 0; x < count; x += kLanes) {
    // As 16-bit numbers the pixels' pairs; the first of a pair is in the lower byte.
    UShort16 before, here, after;
    std::memcpy(&before, row + 2 * x - 2, sizeof(before));
    std::memcpy(&here, row + 2 * x, sizeof(here));
    std::memcpy(&after, row + 2 * x + 2, sizeof(after));
    if (std::endian::native == std::endian::big) {
      before = before << 8 | before >> 8;
      here = here << 8 | here >> 8;
      after = after << 8 | after >> 8;
    }
    const UShort16 sum =
        (before & 255) + (after & 255) + 6 * (here & 255) + 4 * ((before >> 8) + (here >> 8));
    std::memcpy(sums + x, &sum, sizeof(sum));
  }
  for (const int x : {0, count - 1}) {
    int pixel[5];
    for (int i = 0; i < 5; ++i) pixel[i] = row[Mirrored(2 * x + i - 2, width)];
    sums[x] = static_cast<uint16_t>(pixel[0] + pixel[4] + 6 * pixel[2] + 4 * (pixel[1] + pixel[3]));
  }
}

// The same as cv::pyrDown with its default border, in a third of the time. `image` and `half` lie
// in padded images, so that one may read, and write to `half`, beyond the ends of rows.
PORTOLAN_VECTOR_CLONES void HalveImage(const cv::Mat& image, cv::Mat* half) {
  constexpr int kKept = 8;  // at least the five rows of a result, a power of two
  const int width = half->cols, stride = (width + kLanes - 1) / kLanes * kLanes;
  std::vector<uint16_t> kept(static_cast<size_t>(kKept) * stride);
  int done = 0;
  for (int y = 0; y < half->rows; ++y) {
    for (; done < std::min(2 * y + 3, image.rows); ++done) {
      AddAlongRow(image.ptr<uint8_t>(done), image.cols, &kept[done % kKept * stride]);
    }
    const uint16_t* rows[5];
    for (int i = 0; i < 5; ++i) {
      rows[i] = &kept[Mirrored(2 * y + i - 2, image.rows) % kKept * stride];
    }
    uint8_t* to = half->ptr<uint8_t>(y);
    for (int x = 0; x < width; x += kLanes) {
      UShort16 first, second, middle, fourth, last;
      std::memcpy(&first, rows[0] + x, sizeof(first));
      std::memcpy(&second, rows[1] + x, sizeof(second));
      std::memcpy(&middle, rows[2] + x, sizeof(middle));
      std::memcpy(&fourth, rows[3] + x, sizeof(fourth));
      std::memcpy(&last, rows[4] + x, sizeof(last));
      const UShort16 sum = first + last + 6 * middle + 4 * (second + fourth);
      const Byte16 result = __builtin_convertvector((sum + 128) >> 8, Byte16);
      std::memcpy(to + x, &result, sizeof(result));
    }
  }
}

void FillBorder(const cv::Mat& image, cv::Mat* padded) {
  cv::copyMakeBorder(image, *padded, kPyramidPaddingPx, kPyramidPaddingPx, kPyramidPaddingPx,
                     kPyramidPaddingPx, cv::BORDER_REPLICATE | cv::BORDER_ISOLATED);
}

}  // namespace

bool PyramidLevel::Holds(int x0, int y0, int x1, int y1) const {
  return x0 >= -kPyramidPaddingPx && y0 >= -kPyramidPaddingPx &&
         x1 < width_px + kPyramidPaddingPx && y1 < height_px + kPyramidPaddingPx;
}

void ImagePyramid::Build(const cv::Mat& gray, int levels) {
  stored_.resize(levels + 1);
  images_.resize(levels + 1);
  cv::Size size = gray.size();
  for (int level = 0; level <= levels; ++level) {
    if (level > 0) size = cv::Size((size.width + 1) / 2, (size.height + 1) / 2);
    if (level > 0 && std::min(size.width, size.height) < kSmallestSidePx) {
      stored_.resize(level);
      images_.resize(level);
      break;
    }
    // With a row more, so that one may read beyond the end of the last.
    const cv::Size padded_size(size.width + 2 * kPyramidPaddingPx,
                               size.height + 2 * kPyramidPaddingPx);
    static_assert(kPyramidSlackPx <= 2 * kPyramidPaddingPx && kLanes <= kPyramidPaddingPx);
    stored_[level].create(padded_size.height + 1, padded_size.width, CV_8UC1);
    cv::Mat padded = stored_[level].rowRange(0, padded_size.height);
    cv::Mat& image = images_[level];
    image = padded(cv::Rect(cv::Point(kPyramidPaddingPx, kPyramidPaddingPx), size));
    if (level == 0) {
      FillBorder(gray, &padded);
    } else {
      HalveImage(images_[level - 1], &image);
      FillBorder(image, &padded);
    }
  }
}

PyramidLevel ImagePyramid::Level(int level) const {
  const cv::Mat& image = images_[level];
  return {image.data, static_cast<ptrdiff_t>(image.step), image.cols, image.rows};
}

}  // namespace portolan
