#include "agent/local_adjustment/live_localizer.h"

#include <gtest/gtest.h>

#include "tests/agent/local_adjustment/moving_camera.h"

namespace portolan {
namespace {

constexpr int kFramesPerSubmap = 45;

// Feeds the localizer as the agent's runner does, submaps of equal length.
class Localizing : public ::testing::Test {
 protected:
  LiveFrame Frame(int frame) {
    const Rigid3 odometry = odometry_.Next(frame);
    LiveFrame live;
    live.time = scene_.Time(frame);
    live.sequence_number = static_cast<uint32_t>(frame / kFramesPerSubmap);
    live.begins_submap = frame % kFramesPerSubmap == 0;
    if (live.begins_submap) {
      if (frame > 0) {
        Close(live.sequence_number - 1, odometry);
        if (live.sequence_number != broken_) {
          live.predecessor_from_submap = odometry_from_submap_.Inverse() * odometry;
        }
      }
      odometry_from_submap_ = odometry;
      corrector_.OpenSubmap(live.sequence_number, live.predecessor_from_submap);
      keyframes_.clear();
    }
    live.submap_from_camera = odometry_from_submap_.Inverse() * odometry;
    live.tracked = true;
    live.is_keyframe = frame % kFramesPerKeyframe == 0;
    if (live.is_keyframe) AddKeyframe(live.time, live.submap_from_camera);
    sights_ = scene_.Sights(frame);
    live.sights = sights_;
    return live;
  }

  // The server's answer for a closed submap: the truth, in another frame.
  void Correct(uint32_t sequence_number) { Correct(sequence_number, 7, sequence_number + 1); }
  void Correct(uint32_t sequence_number, int64_t component, uint64_t map_version) {
    SubmapPlacement placement;
    placement.sequence_number = sequence_number;
    placement.component = ComponentId(component);
    const int first = static_cast<int>(sequence_number) * kFramesPerSubmap;
    placement.world_from_submap =
        world_from_truth_ * Similarity3::FromRigid(MovingCamera::WorldFromCamera(first));
    for (int k = first; k <= first + kFramesPerSubmap; k += kFramesPerKeyframe) {
      placement.adjusted_submap_from_camera.push_back(
          MovingCamera::WorldFromCamera(first).Inverse() * MovingCamera::WorldFromCamera(k));
    }
    ASSERT_TRUE(corrector_.Apply({map_version, {placement}, false}).ok());
  }

  // All points as one view of another agent's, which lie off by `shift`.
  LandmarkOffer Offer(const Eigen::Vector3d& shift, int64_t component) const {
    LandmarkOffer offer;
    offer.view = 1;
    offer.component = ComponentId(component);
    offer.world_from_camera =
        world_from_truth_ * Similarity3::FromRigid(MovingCamera::WorldFromCamera(90));
    offer.world_from_camera.translation += shift;
    const Rigid3 view_from_truth = MovingCamera::WorldFromCamera(90).Inverse();
    for (size_t i = 0; i < scene_.points().size(); ++i) {
      const Eigen::Vector3d point = view_from_truth * scene_.points()[i];
      if (point.z() < 1 || point.head<2>().norm() > point.z()) continue;
      offer.landmarks.push_back(
          {point, 1e-3, 1e-3, MovingCamera::DescriptorOf(TrackId(static_cast<uint32_t>(i)))});
    }
    return offer;
  }
  // The worst distance to the truth, moved by `shift`, of frames 80 to 100 with this offer.
  double ErrorWithOffer(const Eigen::Vector3d& shift, int64_t component) {
    double worst = 0;
    for (int frame = 0; frame <= 100; ++frame) {
      LiveFrame live = Frame(frame);
      const std::vector<Feature> features = scene_.Features(frame);
      if (live.is_keyframe) live.features = features;
      PlacedPose placed = localizer_.Localize(live, &corrector_);
      if (frame == 60) Correct(0);
      if (frame == 65) {
        MapCorrection correction;
        correction.map_version = 1;
        correction.offers.push_back(Offer(shift, component));
        EXPECT_TRUE(corrector_.Apply(correction).ok());
      }
      if (frame < 80) continue;
      placed.frame_from_camera.translation -= shift;
      worst = std::max(worst, WorldError(placed, frame));
    }
    return worst;
  }

  double WorldError(const PlacedPose& placed, int frame) const {
    const Rigid3 truth = world_from_truth_ * MovingCamera::WorldFromCamera(frame);
    return (placed.frame_from_camera.translation - truth.translation).norm();
  }

  MovingCamera scene_;
  DriftingOdometry odometry_{0.01};
  const Similarity3 world_from_truth_{
      0.8, Eigen::Quaterniond(RotationExp({1, 0.5, -0.2})), {-1, 2, 4}};
  PoseCorrector corrector_;
  LiveLocalizer localizer_{{}, {}, scene_.camera()};
  uint32_t broken_ = 0;  // the submap, not the first, that has no link

 private:
  void AddKeyframe(Timestamp time, const Rigid3& submap_from_camera) {
    Keyframe keyframe;
    keyframe.time = time;
    keyframe.submap_from_camera = submap_from_camera;
    keyframes_.push_back(keyframe);
  }
  void Close(uint32_t sequence_number, const Rigid3& odometry) {
    Submap submap;
    submap.key.sequence_number = sequence_number;
    submap.link = sequence_number == 0 ? LinkType::kNone : LinkType::kConnected;
    submap.keyframes = keyframes_;
    const int last = static_cast<int>(sequence_number + 1) * kFramesPerSubmap;
    Keyframe keyframe;
    keyframe.time = scene_.Time(last);
    keyframe.submap_from_camera = odometry_from_submap_.Inverse() * odometry;
    submap.keyframes.push_back(keyframe);
    corrector_.CloseSubmap(submap);
  }

  Rigid3 odometry_from_submap_;
  std::vector<Keyframe> keyframes_;
  std::vector<LiveSight> sights_;
};

TEST_F(Localizing, WithoutCorrectionsTheFrameIsThatOfTheOldestSubmap) {
  for (int frame = 0; frame < 120; ++frame) {
    const PlacedPose placed = localizer_.Localize(Frame(frame), &corrector_);
    EXPECT_FALSE(placed.in_world);
    EXPECT_EQ(placed.frame_submap, 0u);
  }
}

TEST_F(Localizing, GoesOnFromTheCorrectionAcrossBorders) {
  double plain_error = 0;
  for (int frame = 0; frame < 190; ++frame) {
    const LiveFrame live = Frame(frame);
    const PlacedPose placed = localizer_.Localize(live, &corrector_);
    // The answer to submap 0 comes while submap 1 is open, that to submap 1 long after it.
    if (frame == 60) Correct(0);
    if (frame == 120) Correct(1);
    if (frame <= 60) continue;
    ASSERT_TRUE(placed.in_world);
    EXPECT_EQ(placed.component, ComponentId(7));
    EXPECT_EQ(placed.map_version, frame <= 120 ? 1u : 2u);
    EXPECT_LT(WorldError(placed, frame), 0.01) << frame;
    plain_error =
        WorldError(corrector_.Place(live.sequence_number, live.submap_from_camera), frame);
  }
  // By the filter's motion alone, from the same correction.
  EXPECT_GT(plain_error, 0.5);
}

TEST_F(Localizing, ABrokenLinkBeginsAnew) {
  broken_ = 1;
  for (int frame = 0; frame < 80; ++frame) {
    const PlacedPose placed = localizer_.Localize(Frame(frame), &corrector_);
    if (frame == 60) Correct(0);
    if (frame < kFramesPerSubmap) continue;
    EXPECT_FALSE(placed.in_world);
    EXPECT_EQ(placed.frame_submap, 1u);
    if (frame == kFramesPerSubmap) {
      EXPECT_EQ(placed.frame_from_camera.translation, Eigen::Vector3d::Zero());
    }
  }
}

TEST_F(Localizing, LeavesAWorldThatIsNoMore) {
  for (int frame = 0; frame < 215; ++frame) {
    const PlacedPose placed = localizer_.Localize(Frame(frame), &corrector_);
    if (frame == 60) Correct(0);
    // By then the window has none of its keyframes left.
    if (frame == 210) Correct(0, 9, 2);
    if (frame <= 60) continue;
    ASSERT_TRUE(placed.in_world);
    EXPECT_EQ(placed.component, ComponentId(frame <= 210 ? 7 : 9)) << frame;
  }
}

// The map has moved what is offered; the submap's own correction is not there yet.
TEST_F(Localizing, HoldsOnToOfferedLandmarks) {
  EXPECT_LT(ErrorWithOffer({0.05, -0.03, 0.04}, 7), 0.015);
}

TEST_F(Localizing, OffersOfAnotherWorldChangeNothing) {
  const Eigen::Vector3d shift(0.05, -0.03, 0.04);
  EXPECT_GT(ErrorWithOffer(shift, 8), 0.9 * shift.norm());
}

// The filter finds out that it has been twice as far as it thought.
TEST_F(Localizing, ARestatedStartIsNoMotion) {
  const auto scaled = [](int frame, double scale) {
    Rigid3 pose = MovingCamera::WorldFromCamera(frame);
    pose.translation *= scale;
    return pose;
  };
  corrector_.OpenSubmap(0, std::nullopt);
  Rigid3 last;
  std::vector<FramePose> restated;
  for (int frame = 0; frame <= 40; ++frame) {
    LiveFrame live;
    live.time = scene_.Time(frame);
    live.begins_submap = frame == 0;
    live.submap_from_camera = scaled(frame, 0.5);
    live.tracked = true;
    live.is_keyframe = frame % kFramesPerKeyframe == 0;
    const std::vector<LiveSight> sights = scene_.Sights(frame);
    live.sights = sights;
    last = localizer_.Localize(live, &corrector_).frame_from_camera;
    restated.push_back({live.time, scaled(frame, 1)});
  }
  LiveFrame live;
  live.time = scene_.Time(41);
  live.submap_from_camera = scaled(41, 1);
  live.tracked = true;
  live.restated = restated;
  const Rigid3 now = localizer_.Localize(live, &corrector_).frame_from_camera;
  const double step = (scaled(41, 1).translation - scaled(40, 1).translation).norm();
  EXPECT_NEAR((now.translation - last.translation).norm(), 0.5 * step, 0.1 * step);
}

TEST_F(Localizing, UntrackedFramesKeepTheFiltersPrediction) {
  for (int frame = 0; frame < 30; ++frame) localizer_.Localize(Frame(frame), &corrector_);
  LiveFrame live = Frame(30);
  live.tracked = false;
  live.submap_from_camera.translation.x() += 0.5;
  const PlacedPose placed = localizer_.Localize(live, &corrector_);
  EXPECT_EQ(placed.frame_from_camera.translation, live.submap_from_camera.translation);
}

}  // namespace
}  // namespace portolan
