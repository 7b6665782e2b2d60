// The frames of a SequenceListing.
#ifndef PORTOLAN_AGENT_IMAGE_SOURCE_LISTED_STREAM_H_
#define PORTOLAN_AGENT_IMAGE_SOURCE_LISTED_STREAM_H_

#include <utility>
#include <vector>

#include "agent/image_source/frame_stream.h"
#include "agent/image_source/image_decoder.h"
#include "agent/image_source/sequence_listing.h"

namespace portolan {

class ListedStream : public FrameStream {
 public:
  explicit ListedStream(std::vector<ListedFrame> frames) : frames_(std::move(frames)) {}

  std::optional<FrameHeader> Advance() override;
  StatusOr<FrameImages> Decode() override;

 private:
  std::vector<ListedFrame> frames_;
  size_t next_ = 0;
  ImageDecoder decoder_;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_IMAGE_SOURCE_LISTED_STREAM_H_
