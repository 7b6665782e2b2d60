#include "agent/local_adjustment/row_motion.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/agent/local_adjustment/moving_camera.h"

namespace portolan {
namespace {

constexpr double kReadout = 0.02;
constexpr double kFrameTime = 0.04;

// MovingCamera's, held by a hand that shakes.
Rigid3 PoseAt(double frame) {
  const int before = static_cast<int>(std::floor(frame));
  const Rigid3 a = MovingCamera::WorldFromCamera(before);
  const Rigid3 b = MovingCamera::WorldFromCamera(before + 1);
  const double share = frame - before, time_s = kFrameTime * frame;
  const Eigen::Quaterniond shaken(RotationExp(
      {0.04 * std::sin(8 * time_s), 0.05 * std::sin(11 * time_s), 0.03 * std::sin(6 * time_s)}));
  return {a.rotation.slerp(share, b.rotation) * shaken,
          (1 - share) * a.translation + share * b.translation};
}

// What a sensor that is read from top to bottom sees; a third of the tracks.
std::vector<LiveSight> RollingSights(const MovingCamera& scene, int frame, double readout_s) {
  std::vector<LiveSight> sights;
  for (size_t i = 0; i < scene.points().size(); i += 3) {
    auto pixel = scene.camera().Project(PoseAt(frame).Inverse() * scene.points()[i]);
    for (int round = 0; pixel && round < 4; ++round) {
      const double share = pixel->y() / scene.camera().height_px() - 0.5;
      pixel = scene.camera().Project(PoseAt(frame + share * readout_s / kFrameTime).Inverse() *
                                     scene.points()[i]);
    }
    if (!pixel || !scene.camera().IsInImage(*pixel)) continue;
    sights.push_back({{TrackId(static_cast<uint32_t>(i)), pixel->cast<float>(), 0.5f}, true});
  }
  return sights;
}

// The mean distance from where a camera that sees all at once has the points.
double MeanError(const MovingCamera& scene, int frame, double readout_s,
                 const std::vector<LiveSight>& sights) {
  double sum = 0;
  for (const LiveSight& sight : sights) {
    const Eigen::Vector3d& point = scene.points()[sight.observation.track.value()];
    const Eigen::Vector2d at_once = *scene.camera().Project(PoseAt(frame).Inverse() * point);
    const Eigen::Vector2f corrected =
        sight.observation.pixel + static_cast<float>(readout_s) * sight.row_motion;
    sum += (corrected.cast<double>() - at_once).norm();
  }
  return sum / static_cast<double>(sights.size());
}

TEST(RowMotion, IsWhatTheReadoutMovesPixelsBy) {
  const MovingCamera scene;
  RowMotion row_motion(scene.camera().height_px());
  std::vector<LiveSight> sights[3];
  for (int i = 0; i < 3; ++i) {
    EXPECT_FALSE(row_motion.middle().has_value());
    sights[i] = RollingSights(scene, 99 + i, kReadout);
    row_motion.Measure(scene.Time(99 + i), &sights[i]);
  }
  ASSERT_EQ(row_motion.middle(), scene.Time(100));
  // Tracks that are new to the frame are left as they are.
  std::vector<LiveSight> causal = sights[1];
  std::erase_if(causal, [](const LiveSight& sight) { return sight.row_motion.isZero(0); });
  ASSERT_GT(causal.size(), 20u);
  const double before = MeanError(scene, 100, 0, causal);
  EXPECT_GT(before, 0.4);
  EXPECT_LT(MeanError(scene, 100, kReadout, causal), 0.35 * before);
  for (const auto& [track, motion] : row_motion.MeasureMiddle()) {
    for (LiveSight& sight : causal) {
      if (sight.observation.track == track) sight.row_motion = motion;
    }
  }
  EXPECT_LT(MeanError(scene, 100, kReadout, causal), 0.1 * before);
}

TEST(RowMotion, ALongPauseTellsNone) {
  const MovingCamera scene;
  RowMotion row_motion(scene.camera().height_px());
  for (int frame : {0, 10}) {
    std::vector<LiveSight> sights = scene.Sights(frame);
    row_motion.Measure(scene.Time(frame), &sights);
    for (const LiveSight& sight : sights) EXPECT_TRUE(sight.row_motion.isZero(0));
  }
}

// Returns the last pose.
Rigid3 DriveRolling(const MovingCamera& scene, int first, int last, double readout_s,
                    LocalAdjustment* window) {
  RowMotion row_motion(scene.camera().height_px());
  Rigid3 pose;
  for (int frame = first; frame <= last; ++frame) {
    std::vector<LiveSight> sights = RollingSights(scene, frame, readout_s);
    row_motion.Measure(scene.Time(frame), &sights);
    if (frame % kFramesPerKeyframe == 1 && row_motion.middle()) {
      for (const auto& [track, motion] : row_motion.MeasureMiddle()) {
        window->SetRowMotion(track, motion);
      }
    }
    pose = window->Locate(PoseAt(0).Inverse() * PoseAt(frame), sights);
    if (frame % kFramesPerKeyframe == 0) window->AddKeyframe(scene.Time(frame));
  }
  return pose;
}

// Returns the readout that a window over 300 frames finds.
double Found(const MovingCamera& scene, double readout_s) {
  LocalAdjustment window({}, scene.camera());
  DriveRolling(scene, 0, 300, readout_s, &window);
  return window.readout_s();
}

TEST(RowMotion, TheWindowFindsTheReadout) {
  const MovingCamera scene;
  EXPECT_NEAR(Found(scene, kReadout), kReadout, 0.1 * kReadout);
  EXPECT_NEAR(Found(scene, -kReadout), -kReadout, 0.1 * kReadout);
  EXPECT_NEAR(Found(scene, 0), 0, 5e-4);
}

// The map, which takes all rows for seen at once, has placed the held keyframes: what such a camera
// sees is right as it is.
TEST(RowMotion, AWindowInTheWorldTakesAllRowsForSeenAtOnce) {
  const MovingCamera scene;
  LocalAdjustment window({}, scene.camera());
  DriveRolling(scene, 0, 300, kReadout, &window);
  const double found = window.readout_s();
  window.Start();
  DriveRolling(scene, 301, 348, 0, &window);
  std::vector<LocalAdjustment::KeyframePose> told;
  for (int k = 303; k <= 348; k += kFramesPerKeyframe) {
    told.push_back({scene.Time(k), PoseAt(k)});
  }
  ASSERT_TRUE(window.Hold(told));
  EXPECT_EQ(window.readout_s(), 0);
  // More keyframes than those among which lens and readout are looked for. Corrected pixels: 0.034.
  const Rigid3 pose = DriveRolling(scene, 349, 450, 0, &window);
  EXPECT_LT((pose.translation - PoseAt(450).translation).norm(), 0.015);
  window.Start();
  EXPECT_NEAR(window.readout_s(), found, 0.2 * kReadout);
}

}  // namespace
}  // namespace portolan
