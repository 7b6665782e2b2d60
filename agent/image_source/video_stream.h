// The frames of a video file.
#ifndef PORTOLAN_AGENT_IMAGE_SOURCE_VIDEO_STREAM_H_
#define PORTOLAN_AGENT_IMAGE_SOURCE_VIDEO_STREAM_H_

#include <memory>
#include <opencv2/core/mat.hpp>
#include <string>

#include "agent/image_source/frame_stream.h"
#include "agent/image_source/media_library.h"

namespace portolan {

// Times are index / rate: containers' own stamps are often coarse or repeated.
class VideoStream : public FrameStream {
 public:
  // frame_rate_hz 0: the file's. NotFound or InvalidArgument name the file.
  static StatusOr<std::unique_ptr<VideoStream>> Open(const std::string& path, double frame_rate_hz);

  std::optional<FrameHeader> Advance() override;
  StatusOr<FrameImages> Decode() override;

  double frame_rate_hz() const { return frame_rate_hz_; }
  // By the container's header; 0 if it does not say.
  int64_t frame_count() const { return frame_count_; }

 private:
  VideoStream() = default;

  std::string path_;
  std::unique_ptr<VideoReader> reader_;
  double frame_rate_hz_ = 0;
  int64_t frame_count_ = 0;
  int64_t next_ = 0;
};

// Luminance of an 8-bit image of 1, 3 (BGR) or 4 channels; DataLoss otherwise.
StatusOr<cv::Mat> ToGray(const cv::Mat& image);

}  // namespace portolan

#endif  // PORTOLAN_AGENT_IMAGE_SOURCE_VIDEO_STREAM_H_
