#include "tests/server/support/test_submaps.h"

#include "common/base/check.h"
#include "common/wire/submap_wire.h"

namespace portolan::testing {

CameraIntrinsics TestCamera() {
  CameraIntrinsics camera;
  camera.width_px = 640;
  camera.height_px = 480;
  camera.fx_px = camera.fy_px = 500;
  camera.cx_px = 319.5;
  camera.cy_px = 239.5;
  return camera;
}

SessionName TestSession(const std::string& agent, uint64_t session) {
  return {AgentId(agent), SessionId(session)};
}

SessionHello TestHello(const std::string& agent, uint64_t session) {
  SessionHello hello;
  hello.agent = AgentId(agent);
  hello.session = SessionId(session);
  hello.camera = TestCamera();
  hello.software_version = "test";
  return hello;
}

Submap MakeTestSubmap(const SubmapKey& key) {
  Submap submap;
  submap.key = key;
  submap.link = key.sequence_number == 0 ? LinkType::kNone : LinkType::kConnected;
  const Timestamp start = std::chrono::seconds(100 + key.sequence_number);
  for (int i = 0; i < 2; ++i) {
    Keyframe keyframe;
    keyframe.time = start + std::chrono::seconds(i);
    keyframe.submap_from_camera.translation = Eigen::Vector3d(i, 0, 0);
    if (i > 0) keyframe.covariance = 1e-4 * Matrix6d::Identity();
    keyframe.observations.push_back({TrackId(7), {100.f + i, 50.f}, 1.f});
    submap.keyframes.push_back(keyframe);
  }
  for (int i = 0; i < 3; ++i) {
    FramePose frame;
    frame.time = start + std::chrono::milliseconds(500 * i);
    frame.submap_from_camera.translation = Eigen::Vector3d(0.5 * i, 0, 0);
    submap.frames.push_back(frame);
  }
  return submap;
}

v1::SubmapUpload MakeTestUpload(const std::string& agent, uint32_t sequence_number,
                                uint64_t session) {
  const StatusOr<std::string> bytes =
      EncodeSubmap(MakeTestSubmap({AgentId(agent), SessionId(session), sequence_number}));
  PORTOLAN_CHECK(bytes.ok());
  return MakeUpload(sequence_number, *bytes);
}

}  // namespace portolan::testing
