#include "common/submap/frame_correction.h"

#include "tests/support/matchers.h"

namespace portolan {
namespace {

using Eigen::Vector3d;

Similarity3 WorldFromSubmap() {
  Vector7d tangent;
  tangent << 1, 2, 3, 0.2, -0.4, 0.9, std::log(2.5);
  return Similarity3::Exp(tangent);
}

Rigid3 Pose(double x, double yaw) { return {RotationExp(Vector3d(0, 0, yaw)), Vector3d(x, 0, 0)}; }

// Keyframes at 1 s and 2 s; the adjustment moved the second one sideways and turned it.
SubmapCorrection Correction() {
  SubmapCorrection correction;
  correction.world_from_submap = WorldFromSubmap();
  const Rigid3 first = Pose(1, 0.1), second = Pose(2, 0.3);
  const Rigid3 move = {RotationExp(Vector3d(0.01, 0.02, -0.03)), Vector3d(0, 0.2, 0.1)};
  correction.keyframes = {{FromSeconds(1), first, WorldFromSubmap() * first},
                          {FromSeconds(2), second, move * (WorldFromSubmap() * second)}};
  return correction;
}

TEST(CorrectFrame, WithoutKeyframesThePlacementOfTheSubmapHolds) {
  SubmapCorrection correction{WorldFromSubmap(), {}};
  EXPECT_THAT(CorrectFrame(correction, FromSeconds(5), Pose(3, 1)),
              NearRigid(WorldFromSubmap() * Pose(3, 1), 1e-14));
}

TEST(CorrectFrame, EqualsTheAdjustedPoseAtEachKeyframe) {
  const SubmapCorrection correction = Correction();
  for (const CorrectedKeyframe& keyframe : correction.keyframes) {
    EXPECT_THAT(CorrectFrame(correction, keyframe.time, keyframe.submap_from_camera),
                NearRigid(keyframe.world_from_camera, 1e-12));
  }
}

TEST(CorrectFrame, IsContinuousAtTheKeyframes) {
  const SubmapCorrection correction = Correction();
  for (const CorrectedKeyframe& keyframe : correction.keyframes) {
    for (const Duration step : {Duration(-1), Duration(1)}) {
      EXPECT_THAT(CorrectFrame(correction, keyframe.time + step, keyframe.submap_from_camera),
                  NearRigid(keyframe.world_from_camera, 1e-8));
    }
  }
}

TEST(CorrectFrame, NearestKeyframeHoldsOutside) {
  const SubmapCorrection correction = Correction();
  // Before the first nothing was adjusted, so the submap's own placement comes out.
  EXPECT_THAT(CorrectFrame(correction, FromSeconds(0.2), Pose(0.2, 0)),
              NearRigid(WorldFromSubmap() * Pose(0.2, 0), 1e-12));
  // After the last its adjustment moves everything rigidly.
  const Rigid3 move = correction.keyframes[1].world_from_camera *
                      (WorldFromSubmap() * correction.keyframes[1].submap_from_camera).Inverse();
  EXPECT_THAT(CorrectFrame(correction, FromSeconds(9), Pose(7, 1)),
              NearRigid(move * (WorldFromSubmap() * Pose(7, 1)), 1e-12));
}

TEST(CorrectFrame, HalfWayTakesHalfOfTheAdjustment) {
  SubmapCorrection correction = Correction();
  const Vector3d shift(0, 0, 0.4);  // a pure shift in the world
  correction.keyframes[1].world_from_camera = WorldFromSubmap() * Pose(2, 0.3);
  correction.keyframes[1].world_from_camera.translation += shift;
  const Rigid3 plain = WorldFromSubmap() * Pose(1.5, 0.2);
  const Rigid3 corrected = CorrectFrame(correction, FromSeconds(1.5), Pose(1.5, 0.2));
  EXPECT_THAT(corrected.translation, NearMatrix(plain.translation + 0.5 * shift, 1e-12));
}

TEST(CorrectFrame, RepeatedKeyframeTimesGiveFinitePoses) {
  SubmapCorrection correction = Correction();
  correction.keyframes[1].time = correction.keyframes[0].time;
  for (double time : {0.5, 1.0, 1.5}) {
    const Rigid3 pose = CorrectFrame(correction, FromSeconds(time), Pose(1, 0));
    EXPECT_TRUE(pose.translation.allFinite()) << time;
  }
}

}  // namespace
}  // namespace portolan
