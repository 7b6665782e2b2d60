// A camera device. A thread of its own grabs, and only the newest image is kept, so that a slow
// consumer sees the present and not the past.
#ifndef PORTOLAN_AGENT_IMAGE_SOURCE_DEVICE_SOURCE_H_
#define PORTOLAN_AGENT_IMAGE_SOURCE_DEVICE_SOURCE_H_

#include <condition_variable>
#include <memory>
#include <mutex>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <thread>

#include "agent/image_source/frame_range.h"
#include "agent/image_source/image_source.h"
#include "agent/image_source/time_order.h"

namespace portolan {

// The hardware, or a stand-in for it.
class FrameGrabber {
 public:
  virtual ~FrameGrabber() = default;
  // Blocks for the next image and the time it arrived at; an error if the device is gone.
  virtual StatusOr<std::pair<Timestamp, cv::Mat>> Grab() = 0;
};

// Device number of "/dev/videoN" or "N"; no value for anything else.
std::optional<int> ParseDevice(const std::string& path);

// Opens a camera by its number at the calibration's size; times are the system clock's on arrival.
StatusOr<std::unique_ptr<FrameGrabber>> OpenCameraGrabber(int device,
                                                          const CameraIntrinsics& intrinsics,
                                                          double frame_rate_hz);

// start and end count grabbed frames. The destructor stops the thread and waits for the grab
// under way.
class DeviceSource : public ImageSource {
 public:
  DeviceSource(const ImageSourceOptions& options, ImageSourceInfo info,
               std::unique_ptr<FrameGrabber> grabber);
  ~DeviceSource() override;

  StatusOr<std::optional<Frame>> Next() override;

 private:
  void Run();
  // Hands a frame to Next; false when the range has ended.
  bool Offer(Timestamp time, cv::Mat gray);

  const std::unique_ptr<FrameGrabber> grabber_;
  FrameRange range_;        // the thread's
  int64_t next_index_ = 0;  // the thread's
  TimeOrder order_;         // the consumer's

  std::mutex mutex_;
  std::condition_variable changed_;
  // Guarded by mutex_.
  std::optional<Frame> newest_;
  int64_t dropped_ = 0;
  bool stopping_ = false;
  bool ended_ = false;
  Status end_status_;

  std::thread thread_;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_IMAGE_SOURCE_DEVICE_SOURCE_H_
