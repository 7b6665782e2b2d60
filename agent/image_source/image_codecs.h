// The two image formats of nearly all sequences, decoded by their own libraries.
#ifndef PORTOLAN_AGENT_IMAGE_SOURCE_IMAGE_CODECS_H_
#define PORTOLAN_AGENT_IMAGE_SOURCE_IMAGE_CODECS_H_

#include <opencv2/core/mat.hpp>
#include <vector>

namespace portolan {

bool IsJpeg(const std::vector<unsigned char>& bytes);
bool IsPng(const std::vector<unsigned char>& bytes);

// CV_8UC1 with the pixels that cv::imdecode(IMREAD_GRAYSCALE | IMREAD_IGNORE_ORIENTATION) gives:
// the luminance of a JPEG as stored; PNG's colours with 0.299 R + 0.587 G + 0.114 B, transparency
// and the low byte of 16 bits left out. Empty if the bytes are damaged, no such file, larger than
// 2^28 pixels, or a JPEG of four inks.
cv::Mat DecodeJpegGray(const std::vector<unsigned char>& bytes);
cv::Mat DecodePngGray(const std::vector<unsigned char>& bytes);

}  // namespace portolan

#endif  // PORTOLAN_AGENT_IMAGE_SOURCE_IMAGE_CODECS_H_
