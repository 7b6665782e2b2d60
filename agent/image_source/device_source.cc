#include "agent/image_source/device_source.h"

#include <algorithm>
#include <chrono>
#include <utility>

#include "absl/strings/numbers.h"
#include "agent/image_source/media_library.h"
#include "agent/image_source/playback_source.h"
#include "agent/image_source/video_stream.h"
#include "common/base/concat.h"

namespace portolan {
namespace {

constexpr std::string_view kDevicePrefix = "/dev/video";

class CameraGrabber : public FrameGrabber {
 public:
  CameraGrabber(int device, std::unique_ptr<VideoReader> reader)
      : device_(device), reader_(std::move(reader)) {}

  StatusOr<std::pair<Timestamp, cv::Mat>> Grab() override {
    if (!reader_->Grab()) return Gone();
    const Timestamp time = std::chrono::system_clock::now().time_since_epoch();
    cv::Mat image = reader_->Retrieve();
    if (image.empty()) return Gone();
    return std::pair(time, std::move(image));
  }

 private:
  Status Gone() const {
    return absl::UnavailableError(
        Concat("camera device ", device_, ": delivers no image any more; unplugged?"));
  }

  const int device_;
  std::unique_ptr<VideoReader> reader_;
};

}  // namespace

std::optional<int> ParseDevice(const std::string& path) {
  const bool has_prefix = path.compare(0, kDevicePrefix.size(), kDevicePrefix) == 0;
  const std::string number = has_prefix ? path.substr(kDevicePrefix.size()) : path;
  int device;
  if (number.empty() || number.size() > 3 ||
      number.find_first_not_of("0123456789") != number.npos || !absl::SimpleAtoi(number, &device)) {
    return std::nullopt;
  }
  return device;
}

StatusOr<std::unique_ptr<FrameGrabber>> OpenCameraGrabber(int device,
                                                          const CameraIntrinsics& intrinsics,
                                                          double frame_rate_hz) {
  PORTOLAN_ASSIGN_OR_RETURN(MediaLibrary * library, LoadMediaLibrary());
  std::unique_ptr<VideoReader> reader =
      library->OpenCamera(device, {intrinsics.width_px, intrinsics.height_px, frame_rate_hz});
  if (reader == nullptr) {
    return absl::NotFoundError(Concat("camera device ", device, ": cannot be opened"));
  }
  return std::make_unique<CameraGrabber>(device, std::move(reader));
}

DeviceSource::DeviceSource(const ImageSourceOptions& options, ImageSourceInfo info,
                           std::unique_ptr<FrameGrabber> grabber)
    : grabber_(std::move(grabber)), range_(options), order_(options.max_out_of_order) {
  info_ = std::move(info);
  thread_ = std::thread([this] { Run(); });
}

DeviceSource::~DeviceSource() {
  {
    std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  thread_.join();
}

void DeviceSource::Run() {
  Status status;
  while (true) {
    {
      std::lock_guard lock(mutex_);
      if (stopping_) break;
    }
    auto grabbed = grabber_->Grab();
    if (!grabbed.ok()) {
      status = grabbed.status();
      break;
    }
    StatusOr<cv::Mat> gray = ToGray(grabbed->second);
    if (!gray.ok()) {
      status = gray.status();
      break;
    }
    if (!Offer(grabbed->first, std::move(*gray))) break;
  }
  std::lock_guard lock(mutex_);
  ended_ = true;
  end_status_ = std::move(status);
  changed_.notify_all();
}

bool DeviceSource::Offer(Timestamp time, cv::Mat gray) {
  const int64_t index = next_index_++;
  const FrameRange::Place place = range_.PlaceOf(index, time);
  if (place == FrameRange::Place::kBeyond) return false;
  if (place == FrameRange::Place::kSkipped) return true;
  std::lock_guard lock(mutex_);
  if (newest_) ++dropped_;
  newest_ = Frame{time, std::move(gray), {}, Concat("frame ", index), index};
  changed_.notify_all();
  return true;
}

StatusOr<std::optional<Frame>> DeviceSource::Next() {
  while (true) {
    std::optional<Frame> frame;
    {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [this] { return newest_ || ended_; });
      counts_.dropped = dropped_;
      if (!newest_) {
        PORTOLAN_RETURN_IF_ERROR(end_status_);
        return std::optional<Frame>();
      }
      frame = std::exchange(newest_, std::nullopt);
    }
    // The system's clock may be set back.
    const StatusOr<bool> usable = order_.Take(frame->time, std::nullopt, frame->name);
    counts_.out_of_order = order_.skipped();
    PORTOLAN_RETURN_IF_ERROR(usable.status());
    if (!*usable) continue;
    PORTOLAN_RETURN_IF_ERROR(
        CheckImageSize(frame->gray, info_.calibration.intrinsics, frame->name));
    ++counts_.delivered;
    return frame;
  }
}

}  // namespace portolan
