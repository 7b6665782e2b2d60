// OpenCV's readers of videos, cameras and the rarer image formats. They bring two hundred shared
// libraries, 60 MB and a tenth of a second of the processor's time, so they are in a library of
// their own, portolan-media.so beside the program, that is loaded when first asked for.
#ifndef PORTOLAN_AGENT_IMAGE_SOURCE_MEDIA_LIBRARY_H_
#define PORTOLAN_AGENT_IMAGE_SOURCE_MEDIA_LIBRARY_H_

#include <memory>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "common/base/status.h"

namespace portolan {

// The frames of a video file or a camera. No function throws. Thread-compatible.
class VideoReader {
 public:
  virtual ~VideoReader() = default;
  // The next frame; false at the end or when the device is gone.
  virtual bool Grab() = 0;
  // The grabbed frame, of any type; empty if it cannot be decoded. May share a buffer that the next
  // Grab overwrites.
  virtual cv::Mat Retrieve() = 0;
  // Of the container's header; 0 or less if it does not say.
  virtual double FrameRateHz() = 0;
  virtual double FrameCount() = 0;
};

// Wishes; a device may deliver something else.
struct CameraSettings {
  int width_px = 0;
  int height_px = 0;
  double frame_rate_hz = 0;  // 0: the device's
};

// No function throws. Thread-safe.
class MediaLibrary {
 public:
  virtual ~MediaLibrary() = default;
  // An image file's bytes as CV_8UC1; empty if they are no image.
  virtual cv::Mat DecodeGray(const std::vector<unsigned char>& bytes) = 0;
  // Null if it is no video that can be decoded.
  virtual std::unique_ptr<VideoReader> OpenVideo(const std::string& path) = 0;
  // Null if there is no such device.
  virtual std::unique_ptr<VideoReader> OpenCamera(int device, const CameraSettings& settings) = 0;
};

// Loads it at the first call; it stays. FailedPrecondition says why it cannot be loaded.
// Thread-safe.
StatusOr<MediaLibrary*> LoadMediaLibrary();

}  // namespace portolan

#endif  // PORTOLAN_AGENT_IMAGE_SOURCE_MEDIA_LIBRARY_H_
