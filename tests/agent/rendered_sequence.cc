#include "tests/agent/rendered_sequence.h"

#include "tests/synthetic/frame_renderer.h"

namespace portolan {
namespace {

constexpr int kFrames = 100;

}  // namespace

std::vector<TimedImage> RenderImages(const synthetic::Mission& mission, int frames) {
  synthetic::FrameRenderer renderer(mission, 0);
  std::vector<TimedImage> images;
  for (int frame = 0; frame < frames; ++frame) {
    cv::Mat1b image;
    renderer.Render(frame, &image);
    images.push_back({mission.FrameTime(frame), image});
  }
  return images;
}

synthetic::Mission RenderedMission(int frames) {
  synthetic::MissionOptions options;
  options.name = "loop";
  options.frames = frames;
  options.camera = synthetic::MissionOptions::SmallCamera();
  return *synthetic::MakeMission(options);
}

const std::vector<TimedImage>& RenderedImages() {
  static const auto* const images =
      new std::vector<TimedImage>(RenderImages(RenderedMission(kFrames), kFrames));
  return *images;
}

CameraModel RenderedCamera() {
  return *CameraModel::Create(synthetic::MissionOptions::SmallCamera());
}

cv::Mat BlackImage() {
  const CameraIntrinsics camera = synthetic::MissionOptions::SmallCamera();
  return cv::Mat::zeros(camera.height_px, camera.width_px, CV_8UC1);
}

}  // namespace portolan
