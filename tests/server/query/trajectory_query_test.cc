#include "server/query/trajectory_query.h"

#include <gtest/gtest.h>

namespace portolan {
namespace {

// Two keyframes one second apart, frames every 0.25 s; the server moved the second keyframe up.
SubmapState MakeState() {
  Submap raw;
  for (int i = 0; i < 2; ++i) {
    Keyframe keyframe;
    keyframe.time = std::chrono::seconds(i);
    keyframe.submap_from_camera.translation = Eigen::Vector3d(i, 0, 0);
    raw.keyframes.push_back(keyframe);
  }
  for (int i = 0; i <= 4; ++i) {
    FramePose frame;
    frame.time = std::chrono::milliseconds(250 * i);
    frame.submap_from_camera.translation = Eigen::Vector3d(0.25 * i, 0, 0);
    raw.frames.push_back(frame);
  }
  auto refined = std::make_shared<RefinedSubmap>();
  refined->raw = std::make_shared<const Submap>(raw);
  SubmapState state;
  state.refined = refined;
  state.world_from_submap.scale = 2;
  state.world_from_camera.resize(2);
  state.world_from_camera[1].translation = Eigen::Vector3d(2, 0, 1);
  return state;
}

TEST(PosesOf, KeyframesAreThoseOfTheMap) {
  const SubmapState state = MakeState();
  const auto poses = PosesOf(state, /*all_frames=*/false, std::nullopt);
  ASSERT_EQ(poses.size(), 2u);
  EXPECT_EQ(poses[1].world_from_camera.translation, Eigen::Vector3d(2, 0, 1));
}

TEST(PosesOf, FramesLieBetweenTheirKeyframes) {
  const SubmapState state = MakeState();
  const auto poses = PosesOf(state, /*all_frames=*/true, std::nullopt);
  ASSERT_EQ(poses.size(), 5u);
  EXPECT_TRUE(poses[2].world_from_camera.translation.isApprox(Eigen::Vector3d(1, 0, 0.5), 1e-9));
  EXPECT_TRUE(poses[4].world_from_camera.translation.isApprox(Eigen::Vector3d(2, 0, 1), 1e-9));
}

TEST(PosesOf, WhatWasToldIsLeftOut) {
  const SubmapState state = MakeState();
  EXPECT_EQ(PosesOf(state, false, Timestamp(0)).size(), 1u);
  EXPECT_EQ(PosesOf(state, true, Timestamp(std::chrono::milliseconds(250))).size(), 3u);
  EXPECT_EQ(PosesOf(state, true, Timestamp(std::chrono::seconds(1))).size(), 0u);
}

TEST(PlaceInSuccessor, ContinuesAtTheLastKeyframeWithItsScale) {
  const SubmapState state = MakeState();
  Rigid3 submap_from_camera;
  submap_from_camera.translation = Eigen::Vector3d(0, 3, 0);
  EXPECT_TRUE(PlaceInSuccessor(state, submap_from_camera)
                  .translation.isApprox(Eigen::Vector3d(2, 6, 1), 1e-12));
}

}  // namespace
}  // namespace portolan
