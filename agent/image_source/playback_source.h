// Plays a recording: chooses frames, checks them, and keeps to the clock if asked to.
#ifndef PORTOLAN_AGENT_IMAGE_SOURCE_PLAYBACK_SOURCE_H_
#define PORTOLAN_AGENT_IMAGE_SOURCE_PLAYBACK_SOURCE_H_

#include <memory>
#include <optional>

#include "agent/image_source/frame_range.h"
#include "agent/image_source/frame_stream.h"
#include "agent/image_source/image_source.h"
#include "agent/image_source/sequence_listing.h"
#include "agent/image_source/time_order.h"

namespace portolan {

class PlaybackSource : public ImageSource {
 public:
  PlaybackSource(const ImageSourceOptions& options, ImageSourceInfo info,
                 std::unique_ptr<FrameStream> stream, std::vector<ImuSample> imu,
                 std::vector<OdometrySample> odometry, std::vector<GnssFix> gnss = {},
                 std::vector<RangeSample> ranges = {});

  StatusOr<std::optional<Frame>> Next() override;

 private:
  // Waits until the frame is due. False if its successor is due already: then it is dropped.
  bool AwaitDue(const FrameHeader& header);
  // No value if the frame is unreadable but may be skipped.
  StatusOr<std::optional<Frame>> Read(const FrameHeader& header);

  const ImageSourceOptions options_;
  FrameRange range_;
  TimeOrder order_;
  std::unique_ptr<FrameStream> stream_;
  // Sequence time and wall time of the first frame, which the others are due after.
  std::optional<Timestamp> origin_;
  PlaybackClock::Time wall_origin_{};
};

// InvalidArgument naming the image and both sizes if they differ.
Status CheckImageSize(const cv::Mat& image, const CameraIntrinsics& intrinsics,
                      const std::string& name);

}  // namespace portolan

#endif  // PORTOLAN_AGENT_IMAGE_SOURCE_PLAYBACK_SOURCE_H_
