#include "agent/corrections/pose_corrector.h"

#include "tests/support/matchers.h"

namespace portolan {
namespace {

using testing::HasSubstr;

constexpr double kTolerance = 1e-9;

Rigid3 Step(double x, double yaw_rad) {
  return {RotationExp(Eigen::Vector3d(0, yaw_rad, 0)), Eigen::Vector3d(x, 0, 0)};
}

// Three keyframes and five frames, 10 s a submap; ends at Step(1, 0.2).
Submap MakeSubmap(uint32_t sequence_number, LinkType link = LinkType::kConnected) {
  Submap submap;
  submap.key = {AgentId("a"), SessionId(1), sequence_number};
  submap.link = sequence_number == 0 ? LinkType::kNone : link;
  for (int i = 0; i <= 4; ++i) {
    const Timestamp time = std::chrono::milliseconds(10000 * sequence_number + 2500 * i);
    const Rigid3 pose = Step(0.25 * i, 0.05 * i);
    submap.frames.push_back({time, pose});
    if (i % 2 != 0) continue;
    Keyframe keyframe;
    keyframe.time = time;
    keyframe.submap_from_camera = pose;
    submap.keyframes.push_back(keyframe);
  }
  return submap;
}

const Rigid3 kLink = Step(1, 0.2);

SubmapPlacement Placement(uint32_t sequence_number, const Similarity3& world_from_submap) {
  SubmapPlacement placement;
  placement.sequence_number = sequence_number;
  placement.component = ComponentId(5);
  placement.metric = true;
  placement.world_from_submap = world_from_submap;
  return placement;
}

MapCorrection Correction(uint64_t version, std::vector<SubmapPlacement> submaps) {
  MapCorrection correction;
  correction.map_version = version;
  correction.submaps = std::move(submaps);
  return correction;
}

Similarity3 SomeSimilarity() {
  Vector7d tangent;
  tangent << 5, -3, 2, 0.3, 0.4, -0.2, 0.7;
  return Similarity3::Exp(tangent);
}

void CloseSubmaps(PoseCorrector* corrector, uint32_t count) {
  for (uint32_t i = 0; i < count; ++i) corrector->CloseSubmap(MakeSubmap(i));
}

TEST(PoseCorrector, WithoutCorrectionPosesAreOdometry) {
  PoseCorrector corrector;
  CloseSubmaps(&corrector, 2);
  corrector.OpenSubmap(2, kLink);
  const PlacedPose pose = corrector.Place(2, Step(0.5, 0));
  EXPECT_FALSE(pose.in_world);
  EXPECT_EQ(pose.frame_submap, 0u);
  EXPECT_THAT(pose.frame_from_camera, NearRigid(kLink * kLink * Step(0.5, 0), kTolerance));
}

TEST(PoseCorrector, UsesTheCorrectionOfTheSubmapItself) {
  PoseCorrector corrector;
  CloseSubmaps(&corrector, 1);
  const Similarity3 world_from_submap = SomeSimilarity();
  ASSERT_THAT(corrector.Apply(Correction(7, {Placement(0, world_from_submap)})), IsOk());
  const PlacedPose pose = corrector.Place(0, Step(0.5, 0.1));
  EXPECT_TRUE(pose.in_world);
  EXPECT_TRUE(pose.metric);
  EXPECT_EQ(pose.component, ComponentId(5));
  EXPECT_EQ(pose.map_version, 7u);
  EXPECT_THAT(pose.frame_from_camera, NearRigid(world_from_submap * Step(0.5, 0.1), kTolerance));
}

TEST(PoseCorrector, ComposesTheNearestCorrectionAlongConnectedLinks) {
  PoseCorrector corrector;
  CloseSubmaps(&corrector, 3);
  corrector.OpenSubmap(3, kLink);
  const Similarity3 world_from_1 = SomeSimilarity();
  ASSERT_THAT(
      corrector.Apply(Correction(1, {Placement(0, Similarity3()), Placement(1, world_from_1)})),
      IsOk());
  EXPECT_THAT(corrector.Place(3, Step(0.5, 0)).frame_from_camera,
              NearRigid(world_from_1 * (kLink * kLink * Step(0.5, 0)), kTolerance));
}

TEST(PoseCorrector, SuccessorHangsOnTheAdjustedLastKeyframe) {
  PoseCorrector corrector;
  CloseSubmaps(&corrector, 1);
  corrector.OpenSubmap(1, kLink);
  SubmapPlacement placement = Placement(0, SomeSimilarity());
  const Rigid3 adjusted_last = Step(1.1, 0.25);
  placement.adjusted_submap_from_camera = {Rigid3(), Step(0.5, 0.1), adjusted_last};
  ASSERT_THAT(corrector.Apply(Correction(1, {placement})), IsOk());
  EXPECT_THAT(corrector.Place(1, Step(0.5, 0)).frame_from_camera,
              NearRigid(placement.world_from_submap * (adjusted_last * Step(0.5, 0)), kTolerance));
}

TEST(PoseCorrector, BrokenLinkHasNoWorldPose) {
  PoseCorrector corrector;
  CloseSubmaps(&corrector, 2);
  corrector.OpenSubmap(2, std::nullopt);
  ASSERT_THAT(corrector.Apply(Correction(1, {Placement(1, SomeSimilarity())})), IsOk());
  const PlacedPose pose = corrector.Place(2, Step(0.5, 0));
  EXPECT_FALSE(pose.in_world);
  EXPECT_EQ(pose.frame_submap, 2u);
  EXPECT_THAT(pose.frame_from_camera, NearRigid(Step(0.5, 0), kTolerance));
}

TEST(PoseCorrector, MissingSubmapBreaksTheChain) {
  PoseCorrector corrector;
  CloseSubmaps(&corrector, 1);
  corrector.CloseSubmap(MakeSubmap(2));
  ASSERT_THAT(corrector.Apply(Correction(1, {Placement(0, SomeSimilarity())})), IsOk());
  EXPECT_FALSE(corrector.Place(2, Rigid3()).in_world);
}

TEST(PoseCorrector, TellsPlacementsOfOneVersionThatComeInSeveralMessages) {
  PoseCorrector corrector;
  CloseSubmaps(&corrector, 2);
  const auto placed = [](uint32_t number) {
    SubmapPlacement placement = Placement(number, SomeSimilarity());
    placement.adjusted_submap_from_camera.assign(3, Rigid3());
    return placement;
  };
  EXPECT_EQ(corrector.revision(), 0u);
  ASSERT_THAT(corrector.Apply(Correction(7, {placed(0)})), IsOk());
  const uint64_t seen = corrector.revision();
  EXPECT_EQ(corrector.PlacedSince(0).size(), 1u);
  ASSERT_THAT(corrector.Apply(Correction(7, {placed(1)})), IsOk());
  EXPECT_NE(corrector.revision(), seen);
  const auto news = corrector.PlacedSince(seen);
  ASSERT_EQ(news.size(), 1u);
  EXPECT_EQ(news[0].origin.frame_submap, 1u);
  EXPECT_TRUE(corrector.PlacedSince(corrector.revision()).empty());
}

TEST(PoseCorrector, OlderVersionsDoNotReplaceNewerOnes) {
  PoseCorrector corrector;
  CloseSubmaps(&corrector, 1);
  ASSERT_THAT(corrector.Apply(Correction(9, {Placement(0, SomeSimilarity())})), IsOk());
  ASSERT_THAT(corrector.Apply(Correction(8, {Placement(0, Similarity3())})), IsOk());
  EXPECT_EQ(corrector.map_version(), 9u);
  EXPECT_THAT(corrector.Place(0, Rigid3()).frame_from_camera,
              NearRigid(SomeSimilarity() * Rigid3(), kTolerance));
}

TEST(PoseCorrector, RefusesUnknownSubmapsAndWrongKeyframeCountsButTakesTheRest) {
  PoseCorrector corrector;
  CloseSubmaps(&corrector, 1);
  corrector.OpenSubmap(1, kLink);
  SubmapPlacement wrong = Placement(0, SomeSimilarity());
  wrong.adjusted_submap_from_camera = {Rigid3()};
  EXPECT_THAT(corrector.Apply(Correction(1, {wrong})),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("1 keyframes instead of 3")));
  EXPECT_THAT(corrector.Apply(Correction(1, {Placement(77, SomeSimilarity())})),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("submap 77")));
  EXPECT_FALSE(corrector.Place(0, Rigid3()).in_world);
  EXPECT_THAT(corrector.Apply(
                  Correction(1, {Placement(0, SomeSimilarity()), Placement(1, SomeSimilarity())})),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("submap 1, ")));
  EXPECT_TRUE(corrector.Place(0, Rigid3()).in_world);
}

TEST(PoseCorrector, TrajectoryHoldsEveryFrameOnceInOrder) {
  PoseCorrector corrector;
  CloseSubmaps(&corrector, 3);
  const auto trajectory = corrector.Trajectory();
  ASSERT_EQ(trajectory.size(), 13u);
  for (size_t i = 0; i < trajectory.size(); ++i) {
    EXPECT_EQ(trajectory[i].time, std::chrono::milliseconds(2500 * i));
    EXPECT_FALSE(trajectory[i].pose.in_world);
  }
  EXPECT_THAT(trajectory.back().pose.frame_from_camera,
              NearRigid(kLink * kLink * kLink, kTolerance));
}

TEST(PoseCorrector, TrajectoryPassesThroughTheAdjustedKeyframes) {
  PoseCorrector corrector;
  CloseSubmaps(&corrector, 1);
  SubmapPlacement placement = Placement(0, SomeSimilarity());
  placement.adjusted_submap_from_camera = {Rigid3(), Step(0.6, 0.1), Step(1.3, 0.3)};
  ASSERT_THAT(corrector.Apply(Correction(1, {placement})), IsOk());
  const auto trajectory = corrector.Trajectory();
  ASSERT_EQ(trajectory.size(), 5u);
  for (size_t k = 0; k < 3; ++k) {
    EXPECT_TRUE(trajectory[2 * k].pose.in_world);
    EXPECT_THAT(trajectory[2 * k].pose.frame_from_camera,
                NearRigid(placement.world_from_submap * placement.adjusted_submap_from_camera[k],
                          kTolerance));
  }
}

TEST(PoseCorrector, TrajectoryPlacesUncorrectedSubmapsByTheirNeighbours) {
  PoseCorrector corrector;
  CloseSubmaps(&corrector, 3);
  corrector.CloseSubmap(MakeSubmap(3, LinkType::kBroken));
  const Similarity3 world_from_1 = SomeSimilarity();
  ASSERT_THAT(corrector.Apply(Correction(1, {Placement(1, world_from_1)})), IsOk());
  for (const PlacedFrame& frame : corrector.Trajectory()) {
    EXPECT_EQ(frame.pose.in_world, frame.sequence_number != 3);
  }
  const auto trajectory = corrector.Trajectory();
  EXPECT_THAT(trajectory[0].pose.frame_from_camera,
              NearRigid(world_from_1 * kLink.Inverse(), kTolerance));
  EXPECT_THAT(trajectory[12].pose.frame_from_camera,
              NearRigid(world_from_1 * (kLink * kLink), kTolerance));
}

}  // namespace
}  // namespace portolan
