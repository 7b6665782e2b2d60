#include "agent/image_source/listed_stream.h"

namespace portolan {

std::optional<FrameHeader> ListedStream::Advance() {
  if (next_ >= frames_.size()) return std::nullopt;
  const ListedFrame& frame = frames_[next_];
  FrameHeader header;
  header.index = static_cast<int64_t>(next_);
  header.time = frame.time;
  header.name = frame.image.string();
  ++next_;
  if (next_ < frames_.size()) header.next_time = frames_[next_].time;
  return header;
}

StatusOr<FrameImages> ListedStream::Decode() {
  const ListedFrame& frame = frames_[next_ - 1];
  FrameImages images;
  PORTOLAN_ASSIGN_OR_RETURN(images.gray, decoder_.DecodeGray(frame.image));
  if (!frame.right.empty()) {
    PORTOLAN_ASSIGN_OR_RETURN(images.right, decoder_.DecodeGray(frame.right));
  }
  return images;
}

}  // namespace portolan
