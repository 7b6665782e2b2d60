#include "tests/synthetic/mission.h"

#include <algorithm>
#include <cmath>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/support/matchers.h"
#include "tests/synthetic/euroc_writer.h"
#include "tests/synthetic/frame_renderer.h"

namespace portolan::synthetic {
namespace {

using testing::HasSubstr;

// A small image keeps these tests quick.
MissionOptions SmallMission(const std::string& name) {
  MissionOptions options;
  options.name = name;
  CameraIntrinsics& camera = options.camera;
  camera.width_px = 376, camera.height_px = 240;
  camera.fx_px /= 2, camera.fy_px /= 2;
  camera.cx_px = 0.5 * camera.cx_px - 0.25, camera.cy_px = 0.5 * camera.cy_px - 0.25;
  return options;
}

cv::Mat1b RenderFrame(const Mission& mission, int agent, int frame) {
  cv::Mat1b image;
  FrameRenderer(mission, agent).Render(frame, &image);
  return image;
}

TEST(Mission, IsDeterministicBySeed) {
  MissionOptions options = SmallMission("three_agents");
  const Mission first = *MakeMission(options), second = *MakeMission(options);
  options.seed = 2;
  const Mission other = *MakeMission(options);
  const cv::Mat1b image = RenderFrame(first, 1, 60);
  EXPECT_EQ(cv::norm(image, RenderFrame(second, 1, 60), cv::NORM_INF), 0);
  EXPECT_GT(cv::norm(image, RenderFrame(other, 1, 60), cv::NORM_INF), 20);
  EXPECT_GT(cv::norm(image, RenderFrame(first, 2, 60), cv::NORM_INF), 20);
}

TEST(Mission, PixelsDoNotDependOnTheOrderOfTheCalls) {
  const Mission mission = *MakeMission(SmallMission("loop"));
  FrameRenderer renderer(mission, 0);
  cv::Mat1b first, other, again;
  renderer.Render(30, &first);
  renderer.Render(120, &other);
  renderer.Render(30, &again);
  EXPECT_EQ(cv::norm(first, again, cv::NORM_INF), 0);
}

// Every pixel of a view, moved by its depth and the true poses into another view, must find its
// own grey there, unless something hides it or an edge is near.
TEST(Mission, ViewsAgreeThroughTheGroundTruth) {
  const Mission mission = *MakeMission(SmallMission("loop"));
  const CameraModel camera = *CameraModel::Create(mission.options.camera);
  FrameRenderer renderer(mission, 0);
  const Trajectory truth = CameraGroundTruth(mission, 0);
  cv::Mat1f from, to;
  renderer.RenderLight(100, &from);
  const cv::Mat1f depth = renderer.Depth();
  renderer.RenderLight(106, &to);
  const Rigid3 to_from_from = truth[106].world_from_body.Inverse() * truth[100].world_from_body;
  std::vector<double> differences;
  for (int y = 20; y < 220; y += 3) {
    for (int x = 20; x < 356; x += 3) {
      const Eigen::Vector3d ray = *camera.Unproject({x, y});
      const auto pixel = camera.Project(to_from_from * (ray / ray.z() * depth(y, x)));
      if (!pixel || !camera.IsInImage(*pixel, 2)) continue;
      const int column = static_cast<int>(pixel->x()), row = static_cast<int>(pixel->y());
      const float dx = static_cast<float>(pixel->x()) - static_cast<float>(column);
      const float dy = static_cast<float>(pixel->y()) - static_cast<float>(row);
      const float upper = (1 - dx) * to(row, column) + dx * to(row, column + 1);
      const float lower = (1 - dx) * to(row + 1, column) + dx * to(row + 1, column + 1);
      differences.push_back(std::abs((1 - dy) * upper + dy * lower - from(y, x)));
    }
  }
  ASSERT_GT(differences.size(), 4000u);
  std::sort(differences.begin(), differences.end());
  EXPECT_LT(differences[differences.size() / 2], 2.0);
  EXPECT_LT(differences[differences.size() * 8 / 10], 6.0);
}

TEST(Mission, AgentsLoopThroughTheHallWithoutTouchingAnything) {
  for (const std::string& name : MissionNames()) {
    const Mission mission = *MakeMission(SmallMission(name));
    for (size_t i = 0; i < mission.agents.size(); ++i) {
      const Trajectory truth = CameraGroundTruth(mission, static_cast<int>(i));
      EXPECT_GT(PathLength(truth), 12) << name;
      EXPECT_LT(PathLength(truth), 20) << name;
      const Eigen::Vector3d gap =
          truth.back().world_from_body.translation - truth.front().world_from_body.translation;
      EXPECT_LT(gap.norm(), 2.0) << name;
      for (const StampedPose& pose : truth) {
        const Eigen::Vector3d& p = pose.world_from_body.translation;
        EXPECT_TRUE(std::abs(p.x()) < 4.5 && std::abs(p.y()) < 3.5 && p.z() > 0.5 && p.z() < 2.5);
      }
    }
  }
}

TEST(Mission, PureRotationStandsStillWhileItTurns) {
  const Mission mission = *MakeMission(SmallMission("pure_rotation"));
  double turned_rad = 0;
  for (double t = 5.5; t < 9.5; t += 0.05) {
    const BodyState state = mission.agents[0].path.At(t);
    EXPECT_LT(state.velocity_in_world.norm(), 1e-9);
    turned_rad += 0.05 * state.angular_velocity_in_body.norm();
  }
  EXPECT_GT(turned_rad, 1.5);
}

TEST(Mission, NearestSurfacesKeepADistance) {
  const Mission mission = *MakeMission(SmallMission("five_agents"));
  for (size_t i = 0; i < mission.agents.size(); ++i) {
    FrameRenderer renderer(mission, static_cast<int>(i));
    cv::Mat1f light;
    for (int frame = 0; frame < mission.options.frames; frame += 30) {
      renderer.RenderLight(frame, &light);
      double nearest = 0;
      cv::minMaxLoc(renderer.Depth(), &nearest);
      EXPECT_GT(nearest, 0.15) << "agent " << i << " frame " << frame;  // 0 where nothing is hit
    }
  }
}

TEST(Mission, LowTextureIsLow) {
  const auto contrast = [](const std::string& name) {
    MissionOptions options = SmallMission(name);
    options.effects.noise_sigma = 0;
    cv::Mat1b image = RenderFrame(*MakeMission(options), 0, 50);
    cv::Scalar mean, sigma;
    cv::meanStdDev(image, mean, sigma);
    return sigma[0];
  };
  EXPECT_LT(contrast("low_texture"), 0.6 * contrast("loop"));
}

TEST(Mission, RejectsBadOptions) {
  MissionOptions options;
  options.name = "no_such";
  EXPECT_THAT(MakeMission(options),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("three_agents, five_agents")));
  options = {};
  options.frames = 1;
  EXPECT_THAT(MakeMission(options), StatusIs(absl::StatusCode::kInvalidArgument));
  options = {};
  options.camera.width_px = 0;
  EXPECT_THAT(MakeMission(options), StatusIs(absl::StatusCode::kInvalidArgument));
  options = {};
  options.effects.exposure_swing = 1.5;
  EXPECT_THAT(MakeMission(options), StatusIs(absl::StatusCode::kInvalidArgument));
}

}  // namespace
}  // namespace portolan::synthetic
