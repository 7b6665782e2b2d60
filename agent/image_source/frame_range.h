// The frames that --start, --end and --stride choose.
#ifndef PORTOLAN_AGENT_IMAGE_SOURCE_FRAME_RANGE_H_
#define PORTOLAN_AGENT_IMAGE_SOURCE_FRAME_RANGE_H_

#include <optional>

#include "agent/image_source/image_source_options.h"

namespace portolan {

// Asked for each frame in order. Thread-compatible.
class FrameRange {
 public:
  enum class Place { kSkipped, kTaken, kBeyond };

  explicit FrameRange(const ImageSourceOptions& options)
      : start_(options.start), end_(options.end), stride_(options.stride) {}

  Place PlaceOf(int64_t index, Timestamp time);

 private:
  std::optional<FrameLimit> start_, end_;
  int stride_;
  std::optional<Timestamp> origin_;     // time of the sequence's first frame
  std::optional<int64_t> first_index_;  // of the first frame taken; strides count from it
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_IMAGE_SOURCE_FRAME_RANGE_H_
