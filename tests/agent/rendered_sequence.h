// A rendered sequence of one vehicle for the tests of the agent's whole path.
#ifndef PORTOLAN_TESTS_AGENT_RENDERED_SEQUENCE_H_
#define PORTOLAN_TESTS_AGENT_RENDERED_SEQUENCE_H_

#include <opencv2/core/mat.hpp>
#include <vector>

#include "common/camera/camera_model.h"
#include "tests/synthetic/mission.h"

namespace portolan {

struct TimedImage {
  Timestamp time{};
  cv::Mat gray;
};

// The first images of a mission's first agent.
std::vector<TimedImage> RenderImages(const synthetic::Mission& mission, int frames);

// One vehicle that starts at rest, 376 x 240 px at 20 Hz.
synthetic::Mission RenderedMission(int frames);

// The first 100 images of its only agent, rendered at the first call. The pixels are shared:
// clone before a change.
const std::vector<TimedImage>& RenderedImages();

CameraModel RenderedCamera();

// An image of the camera's size without anything in it.
cv::Mat BlackImage();

}  // namespace portolan

#endif  // PORTOLAN_TESTS_AGENT_RENDERED_SEQUENCE_H_
