// Rendered missions: a world, a camera, and one or more agents that fly through it.
#ifndef PORTOLAN_TESTS_SYNTHETIC_MISSION_H_
#define PORTOLAN_TESTS_SYNTHETIC_MISSION_H_

#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/camera/camera_model.h"
#include "tests/synthetic/body_path.h"
#include "tests/synthetic/image_effects.h"
#include "tests/synthetic/imu.h"
#include "tests/synthetic/world.h"

namespace portolan::synthetic {

struct MissionOptions {
  // three_agents, five_agents: overlapping loops round a hall from different starts.
  // loop: one agent. pure_rotation: one agent that stops and turns on the spot.
  // low_texture: one agent between bare walls. repeated_texture: three agents, everything alike.
  std::string name = "three_agents";
  uint64_t seed = 1;
  int frames = 300;  // an agent
  double frame_rate_hz = 20;
  // A loop of 14 m closes in this time; fewer frames see a part of it, more go round again.
  double loop_time_s = 15;
  CameraIntrinsics camera = EurocLikeCamera();
  ImageEffectsOptions effects;
  ImuOptions imu;
  // Of a second camera like the first, this far to the right of it; 0: none.
  double stereo_baseline_m = 0;
  // Of a laser range finder fixed to the camera (RangeMount); 0: none.
  double range_rate_hz = 0;
  Timestamp start_time = std::chrono::seconds(1600000000);

  // 752 x 480, 79 degrees wide, radial-tangential distortion as EuRoC's cam0.
  static CameraIntrinsics EurocLikeCamera();
  // The same view in 376 x 240, which keeps tests quick.
  static CameraIntrinsics SmallCamera();
  // InvalidArgument, naming the field.
  Status Validate() const;
};

struct AgentPlan {
  std::string name;
  BodyPath path;
};

struct Mission {
  MissionOptions options;
  World world;
  Rigid3 body_from_camera;
  std::vector<AgentPlan> agents;

  // The same with the second camera in place of the first, its noise its own.
  Mission OfSecondCamera() const;
  Timestamp FrameTime(int frame) const;
  double FrameTimeSinceStart_s(int frame) const;
  Rigid3 WorldFromCamera(const AgentPlan& agent, double time_s) const;
};

std::vector<std::string> MissionNames();
StatusOr<Mission> MakeMission(const MissionOptions& options);

}  // namespace portolan::synthetic

#endif  // PORTOLAN_TESTS_SYNTHETIC_MISSION_H_
