#include "tests/synthetic/frame_renderer.h"

#include "common/base/check.h"

namespace portolan::synthetic {
namespace {

CameraModel CreateCamera(const CameraIntrinsics& intrinsics) {
  StatusOr<CameraModel> camera = CameraModel::Create(intrinsics);
  PORTOLAN_CHECK(camera.ok());  // MakeMission has tried it
  return *camera;
}

ImageEffectsOptions EffectsOfAgent(const Mission& mission, int agent) {
  ImageEffectsOptions effects = mission.options.effects;
  effects.seed = mission.options.seed * 31 + static_cast<uint64_t>(agent);
  return effects;
}

}  // namespace

FrameRenderer::FrameRenderer(const Mission& mission, int agent)
    : mission_(mission),
      agent_(mission.agents[static_cast<size_t>(agent)]),
      renderer_(CreateCamera(mission.options.camera), mission.world),
      effects_(EffectsOfAgent(mission, agent)) {}

void FrameRenderer::RenderLight(int frame, cv::Mat1f* light) {
  renderer_.Render(mission_.WorldFromCamera(agent_, mission_.FrameTimeSinceStart_s(frame)), light);
}

void FrameRenderer::Render(int frame, cv::Mat1b* image) {
  const double time_s = mission_.FrameTimeSinceStart_s(frame);
  const ImageEffectsOptions& effects = mission_.options.effects;
  const int samples = effects.shutter_s > 0 ? effects.blur_samples : 1;
  cv::Mat1f light, view;
  for (int i = 0; i < samples; ++i) {
    // The shutter is open from half its time before the stamp to half after.
    const double offset_s = ((i + 0.5) / samples - 0.5) * effects.shutter_s;
    renderer_.Render(mission_.WorldFromCamera(agent_, time_s + offset_s), &view);
    if (i == 0) {
      light = view.clone();
    } else {
      light += view;
    }
  }
  if (samples > 1) light /= samples;
  effects_.Apply(light, frame, time_s, image);
}

}  // namespace portolan::synthetic
