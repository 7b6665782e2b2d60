// The images of one agent of a mission: views, motion blur, exposure, noise.
#ifndef PORTOLAN_TESTS_SYNTHETIC_FRAME_RENDERER_H_
#define PORTOLAN_TESTS_SYNTHETIC_FRAME_RENDERER_H_

#include "common/camera/camera_model.h"
#include "tests/synthetic/mission.h"
#include "tests/synthetic/renderer.h"

namespace portolan::synthetic {

// Thread-compatible; borrows the mission. The pixels depend on the mission's options, the agent
// and the frame alone, not on the order of the calls.
class FrameRenderer {
 public:
  // `agent` is an index of mission.agents; the camera of a mission is valid.
  FrameRenderer(const Mission& mission, int agent);

  void Render(int frame, cv::Mat1b* image);
  // The view at the frame's time without blur, exposure and noise; then Depth() is its depth.
  void RenderLight(int frame, cv::Mat1f* light);
  cv::Mat1f Depth() const { return renderer_.Depth(); }

 private:
  const Mission& mission_;
  const AgentPlan& agent_;
  Renderer renderer_;
  ImageEffects effects_;
};

}  // namespace portolan::synthetic

#endif  // PORTOLAN_TESTS_SYNTHETIC_FRAME_RENDERER_H_
