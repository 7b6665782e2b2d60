#include "tests/server/corrections/wall_state.h"

#include <random>
#include <utility>

#include "tests/server/support/test_submaps.h"
#include "tests/support/test_cameras.h"

namespace portolan::testing {

std::shared_ptr<const SubmapState> MakeWallState(const std::string& agent, int64_t id,
                                                 const Rigid3& world_from_camera) {
  std::mt19937_64 random(static_cast<uint64_t>(id));
  std::uniform_real_distribution<double> uniform(-1, 1);
  auto raw = std::make_shared<Submap>(MakeTestSubmap({AgentId(agent), SessionId(1), 0}));
  auto refined = std::make_shared<RefinedSubmap>();
  auto state = std::make_shared<SubmapState>();
  refined->id = SubmapId(id);
  refined->camera = std::make_shared<const CameraModel>(PinholeTestCamera());
  state->component = ComponentId(1);
  state->moved_at_version = 1;
  state->world_from_submap = Similarity3::FromRigid(world_from_camera, 2);
  for (const Keyframe& keyframe : raw->keyframes) {
    refined->submap_from_camera.push_back(keyframe.submap_from_camera);
    state->world_from_camera.push_back(state->world_from_submap * keyframe.submap_from_camera);
  }
  for (int i = 0; i < kWallLandmarks; ++i) {
    const double depth = 2.5 + 0.5 * uniform(random);
    const double right = 0.5 * depth * uniform(random), down = 0.4 * depth * uniform(random);
    const Eigen::Vector3d point(right, down, depth);
    const LandmarkSight sight{refined->id, TrackId(static_cast<uint32_t>(i))};
    const Eigen::Matrix3d covariance = 1e-4 * Eigen::Matrix3d::Identity();
    refined->landmarks.push_back({sight.track, 5, point, covariance});
    state->landmarks.push_back({LandmarkIdOf(sight),
                                state->world_from_submap * point,
                                Eigen::Matrix3d(4 * covariance),
                                5,
                                {sight}});
    Feature feature;
    feature.track = sight.track;
    feature.descriptor.words[0] = random();
    raw->keyframes[0].features.push_back(feature);
  }
  refined->raw = std::move(raw);
  state->refined = std::move(refined);
  return state;
}

}  // namespace portolan::testing
