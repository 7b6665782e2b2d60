#include "agent/local_adjustment/local_adjustment.h"

#include <gtest/gtest.h>

#include "tests/agent/local_adjustment/moving_camera.h"

namespace portolan {
namespace {

// Feeds frames 0 to last; returns where they were said to be.
std::vector<Rigid3> Drive(const MovingCamera& scene, int last, DriftingOdometry odometry,
                          LocalAdjustment* window, const auto& sights_of) {
  std::vector<Rigid3> poses;
  for (int frame = 0; frame <= last; ++frame) {
    poses.push_back(window->Locate(odometry.Next(frame), sights_of(frame)));
    if (frame % kFramesPerKeyframe == 0) window->AddKeyframe(scene.Time(frame));
  }
  return poses;
}

std::vector<Rigid3> Drive(const MovingCamera& scene, int last, DriftingOdometry odometry,
                          LocalAdjustment* window) {
  return Drive(scene, last, odometry, window, [&](int frame) { return scene.Sights(frame); });
}

double Error(const Rigid3& pose, int frame) {
  return (pose.translation - MovingCamera::WorldFromCamera(frame).translation).norm();
}

TEST(LocalAdjustment, ExactPixelsMakeUpForDriftingOdometry) {
  const MovingCamera scene;
  LocalAdjustment window({}, scene.camera());
  const std::vector<Rigid3> poses = Drive(scene, 240, DriftingOdometry(0.01), &window);
  // The unit of length is that of the odometry's first keyframes, which have drifted a little.
  const double unit =
      window.Keyframes().size() > 1
          ? poses[240].translation.norm() / MovingCamera::WorldFromCamera(240).translation.norm()
          : 0;
  EXPECT_GT(unit, 0.85);
  for (const int frame : {60, 120, 180, 240}) {
    Rigid3 pose = poses[static_cast<size_t>(frame)];
    pose.translation /= unit;
    EXPECT_LT(Error(pose, frame), 0.02) << frame;
  }
  // The odometry alone is where half of the way is missing.
  DriftingOdometry odometry(0.01);
  Rigid3 alone;
  for (int frame = 0; frame <= 240; ++frame) alone = odometry.Next(frame);
  EXPECT_GT(Error(alone, 240), 2.0);
  EXPECT_GT(window.scale(), 5.0);
}

// The calibration is several pixels off at the corners, and after the first window no longer.
TEST(LocalAdjustment, WrongLensIsFound) {
  const MovingCamera scene;
  const CameraModel wrong = scene.camera().WithRadial({-0.05, 0.02}).value();
  const Eigen::Vector2d corner(wrong.width_px() - 1, wrong.height_px() - 1);
  const Eigen::Vector3d ray = *scene.camera().Unproject(corner);
  EXPECT_GT((*wrong.Project(ray) - corner).norm(), 3);
  const auto turned_by = [&](int max_lens_windows, double* corner_error) {
    LocalAdjustmentOptions options;
    options.max_lens_windows = max_lens_windows;
    options.trust_distortion = false;
    LocalAdjustment window(options, wrong);
    const std::vector<Rigid3> poses = Drive(scene, 300, DriftingOdometry(0), &window);
    *corner_error = (*window.camera().Project(ray) - corner).norm();
    const Rigid3 motion = poses[150].Inverse() * poses[300];
    const Rigid3 truth =
        MovingCamera::WorldFromCamera(150).Inverse() * MovingCamera::WorldFromCamera(300);
    return motion.rotation.angularDistance(truth.rotation);
  };
  double corner_with = 0, corner_without = 0;
  const double with = turned_by(12, &corner_with), without = turned_by(0, &corner_without);
  EXPECT_LT(corner_with, 0.5);
  EXPECT_GT(corner_without, 3);
  EXPECT_LT(with, 0.5 * without);
}

// What it changes its mind about is no motion of the camera.
TEST(LocalAdjustment, FollowsAnOdometryThatIsRestated) {
  const MovingCamera scene;
  LocalAdjustment window({}, scene.camera());
  Drive(scene, 40, DriftingOdometry(0), &window);
  const double scale = window.scale();
  const Rigid3 before = window.window_from_camera();
  const auto twice = [](int frame) {
    Rigid3 pose = MovingCamera::WorldFromCamera(frame);
    pose.translation *= 2;
    return pose;
  };
  const Rigid3 odometry_from_submap(Eigen::Quaterniond(RotationExp({0.1, 0.2, 0.3})), {1, 2, 3});
  std::vector<FramePose> restated;
  for (int frame = 0; frame <= 40; ++frame) restated.push_back({scene.Time(frame), twice(frame)});
  window.Restate(odometry_from_submap, restated, scene.Time(40));
  EXPECT_NEAR(window.scale(), scale / 2, 0.02 * scale);
  const Rigid3 after = window.Locate(odometry_from_submap * twice(41), {});
  const Rigid3 truth =
      MovingCamera::WorldFromCamera(40).Inverse() * MovingCamera::WorldFromCamera(41);
  const Rigid3 motion = before.Inverse() * after;
  EXPECT_LT((motion.translation - scale * truth.translation).norm(),
            0.05 * truth.translation.norm());
}

TEST(LocalAdjustment, CalibrationWithDistortionIsBelieved) {
  const MovingCamera scene;
  const CameraModel calibrated = scene.camera().WithRadial({-0.01, 0}).value();
  LocalAdjustment window({}, calibrated);
  Drive(scene, 120, DriftingOdometry(0), &window);
  EXPECT_EQ(window.camera().intrinsics(), calibrated.intrinsics());
}

TEST(LocalAdjustment, TakesTheLensThatOthersFound) {
  const MovingCamera scene;
  LocalAdjustment window({}, scene.camera());
  const auto coefficient = [&window] { return window.camera().intrinsics().coefficients[0]; };
  const double before = scene.camera().intrinsics().coefficients[0];
  window.SetLens({0, 0});
  EXPECT_EQ(coefficient(), before);
  // Folds inside the image.
  window.SetLens({-50, 0});
  EXPECT_EQ(coefficient(), before);
  window.SetLens({0.02, 0});
  window.SetLens({0.03, 0});
  EXPECT_NEAR(coefficient(), before + 0.03, 1e-12);
  // It is not looked for any more.
  Drive(scene, 120, DriftingOdometry(0), &window);
  EXPECT_NEAR(coefficient(), before + 0.03, 1e-12);
}

TEST(LocalAdjustment, HeldKeyframesPutTheWindowInTheirFrame) {
  const MovingCamera scene;
  LocalAdjustment window({}, scene.camera());
  DriftingOdometry odometry(0.01);
  const Similarity3 other_from_world{
      2.5, Eigen::Quaterniond(RotationExp({0.3, -1, 2})), {5, 1, -3}};
  for (int frame = 0; frame <= 150; ++frame) {
    const Rigid3 pose = window.Locate(odometry.Next(frame), scene.Sights(frame));
    if (frame % kFramesPerKeyframe == 0) window.AddKeyframe(scene.Time(frame));
    if (frame == 100) {
      std::vector<LocalAdjustment::KeyframePose> held;
      for (int k = 45; k <= 90; k += kFramesPerKeyframe) {
        held.push_back({scene.Time(k), other_from_world * MovingCamera::WorldFromCamera(k)});
      }
      ASSERT_TRUE(window.Hold(held));
      EXPECT_EQ(window.Keyframes().front().time, scene.Time(45));
    }
    if (frame > 100) {
      const Rigid3 truth = other_from_world * MovingCamera::WorldFromCamera(frame);
      EXPECT_LT((pose.translation - truth.translation).norm(), 0.01) << frame;
      EXPECT_LT(pose.rotation.angularDistance(truth.rotation), 1e-3) << frame;
    }
  }
}

// The server had seen nothing after the last corrected keyframes, the window has.
TEST(LocalAdjustment, TheLastCorrectedKeyframesAreAdjustedTheOthersHeld) {
  const MovingCamera scene;
  // 16 keyframes are told, of which seven are not held; of four, two are not.
  const auto error_after = [&](int first, int wrong) {
    LocalAdjustment window({}, scene.camera());
    Drive(scene, 102, DriftingOdometry(0), &window);
    std::vector<LocalAdjustment::KeyframePose> told;
    for (int k = first; k <= 90; k += kFramesPerKeyframe) {
      told.push_back({scene.Time(k), MovingCamera::WorldFromCamera(k)});
      if (k == wrong) told.back().window_from_camera.translation.y() += 0.01;
    }
    EXPECT_TRUE(window.Hold(told));
    for (const LocalAdjustment::KeyframePose& keyframe : window.Keyframes()) {
      if (keyframe.time == scene.Time(wrong)) return Error(keyframe.window_from_camera, wrong);
    }
    ADD_FAILURE() << "keyframe " << wrong << " is not kept";
    return 0.0;
  };
  EXPECT_NEAR(error_after(45, 69), 0.01, 1e-9);
  EXPECT_LT(error_after(45, 72), 0.003);
  EXPECT_LT(error_after(45, 87), 0.003);
  EXPECT_NEAR(error_after(81, 84), 0.01, 1e-9);
}

// Where the held keyframes leave nothing to adjust, the points are still those of the new frame.
TEST(LocalAdjustment, PointsFollowHeldKeyframes) {
  const MovingCamera scene;
  LocalAdjustment window({}, scene.camera());
  // The last keyframe has seen nothing.
  Drive(scene, 33, DriftingOdometry(0), &window,
        [&](int frame) { return frame < 33 ? scene.Sights(frame) : std::vector<LiveSight>(); });
  const Similarity3 other_from_world{
      2.5, Eigen::Quaterniond(RotationExp({0.3, -1, 2})), {5, 1, -3}};
  std::vector<LocalAdjustment::KeyframePose> held;
  for (const int k : {30, 33}) {
    held.push_back({scene.Time(k), other_from_world * MovingCamera::WorldFromCamera(k)});
  }
  ASSERT_TRUE(window.Hold(held));
  // By the odometry the camera stands still.
  const Rigid3 pose = window.Locate(MovingCamera::WorldFromCamera(33), scene.Sights(36));
  const Rigid3 truth = other_from_world * MovingCamera::WorldFromCamera(36);
  EXPECT_LT((pose.translation - truth.translation).norm(), 0.01);
  EXPECT_LT(pose.rotation.angularDistance(truth.rotation), 1e-3);
}

TEST(LocalAdjustment, UnknownKeyframesChangeNothing) {
  const MovingCamera scene;
  LocalAdjustment window({}, scene.camera());
  Drive(scene, 30, DriftingOdometry(0), &window);
  const std::vector<LocalAdjustment::KeyframePose> before = window.Keyframes();
  EXPECT_FALSE(window.Hold(std::vector<LocalAdjustment::KeyframePose>{
      {scene.Time(1), Rigid3::Identity()}, {scene.Time(3), Rigid3::Identity()}}));
  const std::vector<LocalAdjustment::KeyframePose> after = window.Keyframes();
  ASSERT_EQ(after.size(), before.size());
  EXPECT_EQ(after.back().window_from_camera.translation,
            before.back().window_from_camera.translation);
}

// Optical flow on a repeated texture: most of the tracks slip together, only the filter notices.
TEST(LocalAdjustment, FollowsWhatTheFilterTrusts) {
  const MovingCamera scene;
  LocalAdjustment window({}, scene.camera());
  const auto slipping = [&](int frame) {
    std::vector<LiveSight> sights = scene.Sights(frame);
    if (frame < 100) return sights;
    for (LiveSight& sight : sights) {
      if (!sight.trusted) sight.observation.pixel.x() += 25;
    }
    return sights;
  };
  const std::vector<Rigid3> poses = Drive(scene, 150, DriftingOdometry(0), &window, slipping);
  for (const int frame : {99, 100, 110, 130, 150}) {
    EXPECT_LT(Error(poses[static_cast<size_t>(frame)], frame), 0.03) << frame;
  }
}

TEST(LocalAdjustment, WithoutSightsTheOdometryCounts) {
  const MovingCamera scene;
  LocalAdjustment window({}, scene.camera());
  const std::vector<Rigid3> poses = Drive(scene, 90, DriftingOdometry(0), &window, [&](int frame) {
    return frame < 60 ? scene.Sights(frame) : std::vector<LiveSight>();
  });
  EXPECT_LT(Error(poses[90], 90), 0.03);
}

TEST(LocalAdjustment, StartForgets) {
  const MovingCamera scene;
  LocalAdjustment window({}, scene.camera());
  const std::vector<Rigid3> first = Drive(scene, 45, DriftingOdometry(0.01), &window);
  window.Start();
  EXPECT_EQ(window.point_count(), 0);
  const std::vector<Rigid3> second = Drive(scene, 45, DriftingOdometry(0.01), &window);
  EXPECT_EQ(first.back().translation, second.back().translation);
}

TEST(LocalAdjustment, KeepsABoundedNumberOfKeyframes) {
  const MovingCamera scene;
  LocalAdjustmentOptions options;
  options.max_kept_keyframes = 25;
  LocalAdjustment window(options, scene.camera());
  Drive(scene, 120, DriftingOdometry(0), &window);
  EXPECT_EQ(window.Keyframes().size(), 25u);
  EXPECT_EQ(window.Keyframes().back().time, scene.Time(120));
}

TEST(LocalAdjustmentOptions, RefusesWhatMakesNoSense) {
  const auto is_valid = [](int LocalAdjustmentOptions::*member, int value) {
    LocalAdjustmentOptions options;
    options.*member = value;
    return options.Validate().ok();
  };
  EXPECT_TRUE(LocalAdjustmentOptions().Validate().ok());
  EXPECT_FALSE(is_valid(&LocalAdjustmentOptions::max_keyframes, 5));
  EXPECT_FALSE(is_valid(&LocalAdjustmentOptions::max_free_keyframes, 0));
  EXPECT_FALSE(is_valid(&LocalAdjustmentOptions::max_kept_keyframes, 10));
  EXPECT_FALSE(is_valid(&LocalAdjustmentOptions::max_free_after_correction, 2));
  EXPECT_FALSE(is_valid(&LocalAdjustmentOptions::max_start_iterations, 0));
  EXPECT_FALSE(is_valid(&LocalAdjustmentOptions::min_points, 0));
}

}  // namespace
}  // namespace portolan
