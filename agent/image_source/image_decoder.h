// Image files to grey images.
#ifndef PORTOLAN_AGENT_IMAGE_SOURCE_IMAGE_DECODER_H_
#define PORTOLAN_AGENT_IMAGE_SOURCE_IMAGE_DECODER_H_

#include <filesystem>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "common/base/status.h"

namespace portolan {

// Reads a file of any format that OpenCV knows as CV_8UC1; colour is converted in the decoder.
// NotFound if it does not exist, DataLoss if it is empty, truncated (a decoder may deliver such a
// JPEG with a grey lower part) or no image. Keeps its file buffer; thread-compatible.
class ImageDecoder {
 public:
  StatusOr<cv::Mat> DecodeGray(const std::filesystem::path& path);

 private:
  std::vector<unsigned char> bytes_;
};

// True for the file name of an image.
bool HasImageExtension(const std::filesystem::path& path);

}  // namespace portolan

#endif  // PORTOLAN_AGENT_IMAGE_SOURCE_IMAGE_DECODER_H_
