// What playback needs of a recording: headers in order, images on demand.
#ifndef PORTOLAN_AGENT_IMAGE_SOURCE_FRAME_STREAM_H_
#define PORTOLAN_AGENT_IMAGE_SOURCE_FRAME_STREAM_H_

#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>

#include "common/base/status.h"
#include "common/base/time.h"

namespace portolan {

struct FrameHeader {
  int64_t index = 0;  // from 0
  Timestamp time{};
  // When the following frame was taken; no value for the last one.
  std::optional<Timestamp> next_time;
  std::string name;
};

struct FrameImages {
  cv::Mat gray;
  cv::Mat right;  // empty without a second camera
};

// Protocol: Advance, then Decode at most once, and so on. Thread-compatible.
class FrameStream {
 public:
  virtual ~FrameStream() = default;

  // Header of the next frame, without the cost of decoding it; no value at the end.
  virtual std::optional<FrameHeader> Advance() = 0;
  // The images of the frame that Advance returned last.
  virtual StatusOr<FrameImages> Decode() = 0;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_IMAGE_SOURCE_FRAME_STREAM_H_
