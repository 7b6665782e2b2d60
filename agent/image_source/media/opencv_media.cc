// portolan-media.so: the MediaLibrary of OpenCV.
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>
#include <utility>

#include "agent/image_source/media_library.h"

namespace portolan {
namespace {

class OpenCvReader : public VideoReader {
 public:
  explicit OpenCvReader(cv::VideoCapture capture) : capture_(std::move(capture)) {}

  bool Grab() override {
    try {
      return capture_.grab();
    } catch (const cv::Exception&) {
      return false;
    }
  }
  cv::Mat Retrieve() override {
    try {
      cv::Mat image;
      if (capture_.retrieve(image)) return image;
    } catch (const cv::Exception&) {
    }
    return cv::Mat();
  }
  double FrameRateHz() override { return Get(cv::CAP_PROP_FPS); }
  double FrameCount() override { return Get(cv::CAP_PROP_FRAME_COUNT); }

 private:
  double Get(int property) {
    try {
      return capture_.get(property);
    } catch (const cv::Exception&) {
      return 0.0;
    }
  }

  cv::VideoCapture capture_;
};

class OpenCvMedia : public MediaLibrary {
 public:
  cv::Mat DecodeGray(const std::vector<unsigned char>& bytes) override {
    try {
      return cv::imdecode(bytes, cv::IMREAD_GRAYSCALE | cv::IMREAD_IGNORE_ORIENTATION);
    } catch (const cv::Exception&) {
      return cv::Mat();
    }
  }

  std::unique_ptr<VideoReader> OpenVideo(const std::string& path) override {
    try {
      cv::VideoCapture capture;
      // Named, since the others that OpenCV would try are for devices, slow, and leak.
      if (!capture.open(path, cv::CAP_FFMPEG) && !capture.open(path, cv::CAP_OPENCV_MJPEG)) {
        return nullptr;
      }
      return std::make_unique<OpenCvReader>(std::move(capture));
    } catch (const cv::Exception&) {
      return nullptr;
    }
  }

  std::unique_ptr<VideoReader> OpenCamera(int device, const CameraSettings& settings) override {
    try {
      cv::VideoCapture capture;
      if (!capture.open(device, cv::CAP_V4L2)) return nullptr;
      capture.set(cv::CAP_PROP_FRAME_WIDTH, settings.width_px);
      capture.set(cv::CAP_PROP_FRAME_HEIGHT, settings.height_px);
      if (settings.frame_rate_hz > 0) capture.set(cv::CAP_PROP_FPS, settings.frame_rate_hz);
      capture.set(cv::CAP_PROP_BUFFERSIZE, 1);
      return std::make_unique<OpenCvReader>(std::move(capture));
    } catch (const cv::Exception&) {
      return nullptr;
    }
  }
};

}  // namespace
}  // namespace portolan

extern "C" portolan::MediaLibrary* PortolanMediaLibrary() {
  static portolan::OpenCvMedia media;
  return &media;
}
