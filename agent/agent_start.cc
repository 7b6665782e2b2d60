// What a smoothed start changes in the open submap.
#include "agent/agent.h"

namespace portolan {

void Agent::RestateStart() {
  const auto poses = filter_->TakeRestatedPoses();
  if (poses.empty()) return;
  std::vector<FramePose> frames;
  for (const auto& [time, pose] : poses) frames.push_back({time, pose});
  builder_.Restate(frames);
  keyframe_selector_.MoveKeyframe(builder_.open().keyframes.back().submap_from_camera);
  restated_ = builder_.open().frames;
}

}  // namespace portolan
