// The agent with a second camera, on rendered images.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "agent/agent.h"
#include "common/wire/submap_wire.h"
#include "tests/agent/rendered_sequence.h"
#include "tests/support/matchers.h"
#include "tests/synthetic/frame_renderer.h"

namespace portolan {
namespace {

using absl::StatusCode;
using testing::HasSubstr;

constexpr int kFrames = 45;
constexpr double kBaseline_m = 0.11;

// Of RenderedImages()' second camera.
const std::vector<cv::Mat>& SecondImages() {
  static const auto* const images = [] {
    synthetic::Mission mission = RenderedMission(100);
    mission.options.stereo_baseline_m = kBaseline_m;
    const synthetic::Mission of_second = mission.OfSecondCamera();
    synthetic::FrameRenderer renderer(of_second, 0);
    auto* result = new std::vector<cv::Mat>;
    for (int frame = 0; frame < kFrames; ++frame) {
      cv::Mat1b image;
      renderer.Render(frame, &image);
      result->push_back(image);
    }
    return result;
  }();
  return *images;
}

VehicleSensors WithSecondCamera() {
  VehicleSensors sensors;
  sensors.second_camera =
      StereoMount{RenderedCamera(), {Eigen::Quaterniond::Identity(), {-kBaseline_m, 0, 0}}};
  return sensors;
}

std::unique_ptr<Agent> MakeAgent() {
  return *Agent::Create({}, RenderedCamera(), AgentId("tester"), SessionId(7), WithSecondCamera());
}

TEST(AgentWithSecondCamera, SubmapsAreMetric) {
  const synthetic::Mission mission = RenderedMission(100);
  auto agent = MakeAgent();
  std::vector<Submap> submaps;
  for (int i = 0; i < kFrames; ++i) {
    const TimedImage& image = RenderedImages()[i];
    // A second image that is missing now and then is no harm.
    auto result =
        agent->ProcessImage(image.time, image.gray, i % 5 == 4 ? cv::Mat() : SecondImages()[i]);
    ASSERT_THAT(result, IsOk());
    EXPECT_TRUE(result->metric);
    EXPECT_EQ(result->link == LinkType::kBroken, false);
    if (result->closed_submap) submaps.push_back(*std::move(result->closed_submap));
  }
  if (auto last = agent->Finish()) submaps.push_back(*std::move(last));
  ASSERT_FALSE(submaps.empty());
  for (const Submap& submap : submaps) {
    EXPECT_THAT(EncodeSubmap(submap), IsOk());
    EXPECT_TRUE(submap.metric);
    EXPECT_FALSE(submap.gravity_in_submap.has_value());
  }
  // Length of the way of the longest submap, the sum over its keyframes against the truth.
  const Submap& submap = *std::max_element(
      submaps.begin(), submaps.end(),
      [](const Submap& a, const Submap& b) { return a.keyframes.size() < b.keyframes.size(); });
  ASSERT_GE(submap.keyframes.size(), 3u);
  const auto true_camera = [&mission](Timestamp time) {
    return mission.WorldFromCamera(mission.agents[0], ToSeconds(time - mission.FrameTime(0)));
  };
  const Keyframe& first = submap.keyframes.front();
  const Keyframe& last = submap.keyframes.back();
  const double estimate =
      (last.submap_from_camera.translation - first.submap_from_camera.translation).norm();
  const double truth =
      (true_camera(last.time).translation - true_camera(first.time).translation).norm();
  EXPECT_GT(truth, 0.2);
  // Half a pixel of a disparity of five, forty times.
  EXPECT_NEAR(estimate / truth, 1, 0.03);
}

TEST(AgentWithSecondCamera, StartsOnlyWithBothImages) {
  auto agent = MakeAgent();
  for (int i = 0; i < 5; ++i) {
    const auto result = agent->ProcessImage(RenderedImages()[i].time, RenderedImages()[i].gray);
    ASSERT_THAT(result, IsOk());
    EXPECT_FALSE(result->tracked);
  }
  const auto result =
      agent->ProcessImage(RenderedImages()[5].time, RenderedImages()[5].gray, SecondImages()[5]);
  ASSERT_THAT(result, IsOk());
  EXPECT_TRUE(result->tracked);
}

TEST(AgentWithSecondCamera, ASecondImageOfAnotherKindIsRefused) {
  auto agent = MakeAgent();
  const TimedImage& image = RenderedImages()[0];
  EXPECT_THAT(agent->ProcessImage(image.time, image.gray, cv::Mat::zeros(8, 8, CV_8UC1)),
              StatusIs(StatusCode::kInvalidArgument, HasSubstr("second camera")));
  EXPECT_THAT(agent->ProcessImage(image.time, image.gray, cv::Mat::zeros(240, 376, CV_8UC3)),
              StatusIs(StatusCode::kInvalidArgument, HasSubstr("second camera")));
  EXPECT_THAT(agent->ProcessImage(image.time, image.gray, SecondImages()[0]), IsOk());
}

TEST(AgentWithSecondCamera, NotTogetherWithAnImu) {
  VehicleSensors sensors = WithSecondCamera();
  sensors.imu = ImuMount{};
  EXPECT_THAT(Agent::Create({}, RenderedCamera(), AgentId("tester"), SessionId(7), sensors),
              StatusIs(StatusCode::kInvalidArgument, HasSubstr("second camera")));
}

}  // namespace
}  // namespace portolan
