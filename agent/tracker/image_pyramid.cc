#include "agent/tracker/image_pyramid.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>

namespace portolan {
namespace {

constexpr int kSmallestSidePx = 16;

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
    static_assert(kPyramidSlackPx <= 2 * kPyramidPaddingPx);
    stored_[level].create(padded_size.height + 1, padded_size.width, CV_8UC1);
    cv::Mat padded = stored_[level].rowRange(0, padded_size.height);
    cv::Mat& image = images_[level];
    image = padded(cv::Rect(cv::Point(kPyramidPaddingPx, kPyramidPaddingPx), size));
    if (level == 0) {
      FillBorder(gray, &padded);
    } else {
      cv::pyrDown(images_[level - 1], image, size);
      FillBorder(image, &padded);
    }
  }
}

PyramidLevel ImagePyramid::Level(int level) const {
  const cv::Mat& image = images_[level];
  return {image.data, static_cast<ptrdiff_t>(image.step), image.cols, image.rows};
}

}  // namespace portolan
