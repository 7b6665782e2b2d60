// Grey image at powers of two, with a border so that windows may stick out of the image.
#ifndef PORTOLAN_AGENT_TRACKER_IMAGE_PYRAMID_H_
#define PORTOLAN_AGENT_TRACKER_IMAGE_PYRAMID_H_

#include <cstddef>
#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <vector>

namespace portolan {

// Pixels of one level. Readable from -kPyramidPaddingPx to size - 1 + kPyramidPaddingPx.
struct PyramidLevel {
  const uint8_t* origin = nullptr;  // pixel (0, 0)
  ptrdiff_t stride = 0;
  int width_px = 0;
  int height_px = 0;

  const uint8_t* At(int x, int y) const { return origin + y * stride + x; }
  // True if the pixels [x0, x1] x [y0, y1] may be read.
  bool Holds(int x0, int y0, int x1, int y1) const;
};

inline constexpr int kPyramidPaddingPx = 24;
// Bytes that may be read, and mean nothing, to the right of the padding.
inline constexpr int kPyramidSlackPx = 16;

// Pixel p of the image is pixel p / 2^level of a level (5 x 5 Gaussian, every second pixel). Keeps
// its buffers from one image to the next. Thread-compatible.
class ImagePyramid {
 public:
  // gray: CV_8UC1, copied. Builds `levels` further levels, fewer if the smallest would fall under
  // 16 px.
  void Build(const cv::Mat& gray, int levels);

  bool empty() const { return images_.empty(); }
  int num_levels() const { return static_cast<int>(images_.size()); }
  PyramidLevel Level(int level) const;
  // The image itself, valid until the next Build.
  const cv::Mat& image() const { return images_.front(); }

 private:
  std::vector<cv::Mat> stored_;  // with the padding
  std::vector<cv::Mat> images_;  // views into stored_
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_TRACKER_IMAGE_PYRAMID_H_
