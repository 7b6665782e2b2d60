#include "agent/image_source/playback_source.h"

#include <utility>

#include "common/base/concat.h"
#include "common/base/logging.h"

namespace portolan {
namespace {

// After so many warnings of a kind only the counts go on.
constexpr int64_t kMaxWarnings = 5;

}  // namespace

Status CheckImageSize(const cv::Mat& image, const CameraIntrinsics& intrinsics,
                      const std::string& name) {
  if (image.cols == intrinsics.width_px && image.rows == intrinsics.height_px) {
    return absl::OkStatus();
  }
  return absl::InvalidArgumentError(Concat(name, ": image is ", image.cols, " x ", image.rows,
                                           ", but the calibration is for ", intrinsics.width_px,
                                           " x ", intrinsics.height_px));
}

PlaybackSource::PlaybackSource(const ImageSourceOptions& options, ImageSourceInfo info,
                               std::unique_ptr<FrameStream> stream, std::vector<ImuSample> imu,
                               std::vector<OdometrySample> odometry, std::vector<GnssFix> gnss,
                               std::vector<RangeSample> ranges)
    : options_(options),
      range_(options),
      order_(options.max_out_of_order),
      stream_(std::move(stream)) {
  info_ = std::move(info);
  imu_ = std::move(imu);
  odometry_ = std::move(odometry);
  gnss_ = std::move(gnss);
  ranges_ = std::move(ranges);
}

StatusOr<std::optional<Frame>> PlaybackSource::Next() {
  while (const auto header = stream_->Advance()) {
    const FrameRange::Place place = range_.PlaceOf(header->index, header->time);
    if (place == FrameRange::Place::kBeyond) break;
    if (place == FrameRange::Place::kSkipped) continue;
    const StatusOr<bool> usable = order_.Take(header->time, header->next_time, header->name);
    counts_.out_of_order = order_.skipped();
    PORTOLAN_RETURN_IF_ERROR(usable.status());
    if (!*usable) continue;
    if (options_.rate > 0 && !AwaitDue(*header)) {
      ++counts_.dropped;
      continue;
    }
    PORTOLAN_ASSIGN_OR_RETURN(std::optional<Frame> frame, Read(*header));
    if (frame) return frame;
  }
  return std::optional<Frame>();
}

bool PlaybackSource::AwaitDue(const FrameHeader& header) {
  const PlaybackClock::Time now = options_.clock.now();
  if (!origin_) {
    origin_ = header.time;
    wall_origin_ = now;
  }
  const auto due = [&](Timestamp time) {
    return wall_origin_ + FromSeconds(ToSeconds(time - *origin_) / options_.rate);
  };
  if (header.next_time) {
    // With a stride the successor that counts comes as many frames later.
    const Duration step = (*header.next_time - header.time) * options_.stride;
    if (step > Duration::zero() && now >= due(header.time + step)) return false;
  }
  if (now < due(header.time)) options_.clock.sleep_until(due(header.time));
  return true;
}

StatusOr<std::optional<Frame>> PlaybackSource::Read(const FrameHeader& header) {
  StatusOr<FrameImages> images = stream_->Decode();
  if (!images.ok()) {
    if (counts_.unreadable >= options_.max_unreadable) return images.status();
    if (++counts_.unreadable <= kMaxWarnings) {
      LogWarning(std::string(images.status().message()), "; skipped");
    }
    return std::optional<Frame>();
  }
  PORTOLAN_RETURN_IF_ERROR(CheckImageSize(images->gray, info_.calibration.intrinsics, header.name));
  if (!images->right.empty() && info_.right_calibration) {
    PORTOLAN_RETURN_IF_ERROR(CheckImageSize(images->right, info_.right_calibration->intrinsics,
                                            Concat("partner of ", header.name)));
  }
  ++counts_.delivered;
  return std::optional<Frame>(Frame{header.time, std::move(images->gray), std::move(images->right),
                                    header.name, header.index});
}

}  // namespace portolan
