#include "agent/image_source/frame_range.h"

namespace portolan {

FrameRange::Place FrameRange::PlaceOf(int64_t index, Timestamp time) {
  if (!origin_) origin_ = time;
  const Duration since_start = time - *origin_;
  if (end_ && (end_->is_time ? since_start > end_->since_start : index > end_->index)) {
    return Place::kBeyond;
  }
  if (start_ && (start_->is_time ? since_start < start_->since_start : index < start_->index)) {
    return Place::kSkipped;
  }
  if (!first_index_) first_index_ = index;
  return (index - *first_index_) % stride_ == 0 ? Place::kTaken : Place::kSkipped;
}

}  // namespace portolan
