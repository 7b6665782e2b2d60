#include "server/map_builder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>

#include "tests/support/synthetic_map.h"

namespace portolan {
namespace {

std::unique_ptr<MapBuilder> MakeBuilder(const MapBuilderOptions& options = {}) {
  return std::move(MapBuilder::Create(options)).value();
}

SyntheticSubmapsOptions ThreeAgents() {
  SyntheticSubmapsOptions options;
  options.agents = {{0, 2.6, 5, 1.5}, {2.0, 4.6, 5, 1.4}, {4.0, 6.9, 5, 1.6}};
  return options;
}

TEST(MapBuilder, SingleAgentWithoutNoiseIsExact) {
  SyntheticSubmapsOptions options;
  options.pixel_sigma = 0;
  const SyntheticMission mission = MakeSyntheticMission(options);
  const auto builder = MakeBuilder();
  IntegrateMission(mission, 0, 99, true, builder.get());
  const auto snapshot = builder->snapshot();
  ASSERT_EQ(snapshot->components.size(), 1u);
  EXPECT_EQ(snapshot->components[0].id, ComponentId(1));
  EXPECT_LT(KeyframeRms(mission, *snapshot, ComponentId(1)), 2e-4);
  EXPECT_LT(LandmarkMedianError(mission, *snapshot, ComponentId(1)), 1e-3);
}

TEST(MapBuilder, SingleAgentWithNoiseBeatsTheDrift) {
  SyntheticSubmapsOptions options;
  options.outlier_share = 0.03;
  const SyntheticMission mission = MakeSyntheticMission(options);
  const auto builder = MakeBuilder();
  IntegrateMission(mission, 0, 99, true, builder.get());
  // 4.5 m of path, half a pixel of noise, no loop.
  EXPECT_LT(KeyframeRms(mission, *builder->snapshot(), ComponentId(1)), 0.012);
}

TEST(MapBuilder, LoopIsClosed) {
  SyntheticSubmapsOptions options;
  options.agents = {{0, 6.8, 10, 1.5}};
  const SyntheticMission mission = MakeSyntheticMission(options);
  const auto builder = MakeBuilder();
  IntegrateMission(mission, 0, 99, true, builder.get());
  EXPECT_GE(builder->snapshot()->closures->size(), 1u);
  EXPECT_LT(KeyframeRms(mission, *builder->snapshot(), ComponentId(1)), 0.012);
}

// The server is told a lens that is several pixels off at the corners.
TEST(MapBuilder, WrongLensIsFoundAndKept) {
  SyntheticSubmapsOptions options;
  options.agents = {{0, 4.5, 7, 1.5}};
  SyntheticMission mission = MakeSyntheticMission(options);
  const CameraModel truth = *mission.camera;
  mission.camera = std::make_shared<const CameraModel>(truth.WithRadial({0.05, -0.02}).value());
  MapBuilderOptions held;
  held.aligner.adjuster.min_lens_keyframes = 0;
  const auto without = MakeBuilder(held);
  MapBuilderOptions doubting;
  doubting.aligner.adjuster.trust_distortion = false;
  const auto builder = MakeBuilder(doubting);
  IntegrateMission(mission, 0, 99, true, without.get());
  IntegrateMission(mission, 0, 99, true, builder.get());
  const auto snapshot = builder->snapshot();
  const double error = KeyframeRms(mission, *snapshot, ComponentId(1));
  EXPECT_LT(error, 0.5 * KeyframeRms(mission, *without->snapshot(), ComponentId(1)));
  const Eigen::Vector2d corner(truth.width_px() - 1, truth.height_px() - 1);
  const Eigen::Vector3d ray = *truth.Unproject(corner);
  EXPECT_GT((*mission.camera->Project(ray) - corner).norm(), 3);
  for (const auto& state : snapshot->submaps) {
    EXPECT_LT((*state->camera->Project(ray) - corner).norm(), 1);
  }
}

TEST(MapBuilder, CalibrationWithDistortionIsBelieved) {
  SyntheticMission mission = MakeSyntheticMission({});
  mission.camera =
      std::make_shared<const CameraModel>(mission.camera->WithRadial({0.01, 0}).value());
  const auto builder = MakeBuilder();
  IntegrateMission(mission, 0, 99, true, builder.get());
  EXPECT_EQ(builder->snapshot()->submaps.back()->camera, mission.camera);
}

TEST(MapBuilder, LensOfTheSessionIsKnownToANewSubmapOfAContinuedMap) {
  const SyntheticMission mission = MakeSyntheticMission({});
  const auto found =
      std::make_shared<const CameraModel>(mission.camera->WithRadial({0.05, -0.02}).value());
  const auto first = MakeBuilder();
  IntegrateMission(mission, 0, 3, false, first.get());
  auto snapshot = std::make_shared<MapSnapshot>(*first->snapshot());
  for (auto& state : snapshot->submaps) {
    auto changed = std::make_shared<SubmapState>(*state);
    changed->camera = found;
    state = changed;
  }
  const auto continued = MakeBuilder();
  continued->Restore(snapshot);
  IntegrateMission(mission, 3, 4, false, continued.get());
  EXPECT_NE(continued->snapshot()->submaps.back()->camera, mission.camera);
}

// Of a session that lost its track, the small second component does not know the lens better than
// the first, whose map is made with it.
TEST(MapBuilder, LensIsThatOfTheSessionsLargestComponent) {
  SyntheticSubmapsOptions options;
  options.agents = {{0, 3, 6, 1.5}, {3.8, 4.6, 3, 0.3}};
  SyntheticMission mission = MakeSyntheticMission(options);
  mission.camera =
      std::make_shared<const CameraModel>(mission.camera->WithRadial({0.05, -0.02}).value());
  MapBuilderOptions doubting;
  doubting.aligner.adjuster.trust_distortion = false;
  const auto builder = MakeBuilder(doubting);
  SubmapKey key;
  for (const int agent : {0, 1}) {
    for (size_t i = 0; i < mission.submaps.size(); ++i) {
      if (mission.agent_of_submap[i] != agent) continue;
      Submap raw = *mission.submaps[i].submap;
      if (agent == 1) {
        raw.key = {key.agent, key.session, raw.key.sequence_number + 100};
      } else {
        key = raw.key;
      }
      builder->IntegrateSubmap({SubmapId(static_cast<int64_t>(10 * agent + i + 1)),
                                std::make_shared<const Submap>(raw), mission.camera});
      FinishBackgroundWork(builder.get());
    }
  }
  const auto snapshot = builder->snapshot();
  ASSERT_EQ(snapshot->components.size(), 2u);
  EXPECT_GT(AddedRadial(*snapshot->submaps.front()).norm(), 0.03);
  for (const auto& state : snapshot->submaps) {
    EXPECT_EQ(AddedRadial(*state), AddedRadial(*snapshot->submaps.front()));
  }
  // A stored map in which the second component still has an older lens.
  auto stored = std::make_shared<MapSnapshot>(*snapshot);
  for (auto& state : stored->submaps) {
    if (state->component == ComponentId(1)) continue;
    auto older = std::make_shared<SubmapState>(*state);
    older->camera = mission.camera;
    state = older;
  }
  const auto continued = MakeBuilder(doubting);
  continued->Restore(stored);
  continued->RunBackgroundWork(true);
  EXPECT_EQ(AddedRadial(*continued->snapshot()->submaps.front()),
            AddedRadial(*snapshot->submaps.front()));
}

TEST(MapBuilder, ThreeAgentsBecomeOneComponent) {
  const SyntheticMission mission = MakeSyntheticMission(ThreeAgents());
  const auto builder = MakeBuilder();
  IntegrateMission(mission, 0, 99, true, builder.get());
  const auto snapshot = builder->snapshot();
  ASSERT_EQ(snapshot->components.size(), 1u);
  EXPECT_GE(snapshot->closures->size(), 2u);
  EXPECT_LT(KeyframeRms(mission, *snapshot, ComponentId(1)), 0.012);
}

TEST(MapBuilder, LandmarkThatTwoAgentsSawIsOneLandmark) {
  const SyntheticMission mission = MakeSyntheticMission(ThreeAgents());
  const auto builder = MakeBuilder();
  IntegrateMission(mission, 0, 99, true, builder.get());
  int shared = 0;
  int wrong = 0;
  std::set<LandmarkId> ids;
  for (const auto& state : builder->snapshot()->submaps) {
    for (const FusedLandmark& landmark : state->landmarks) {
      EXPECT_TRUE(ids.insert(landmark.id).second);
      EXPECT_EQ(landmark.id, LandmarkIdOf(landmark.sights.front()));
      std::set<int> agents;
      std::set<int> points;
      for (const LandmarkSight& sight : landmark.sights) {
        const int agent = mission.agent_of_submap[sight.submap.value() - 1];
        agents.insert(agent);
        points.insert(mission.point_ids_of_tracks[agent].at(sight.track));
      }
      shared += agents.size() > 1 ? 1 : 0;
      wrong += points.size() > 1 ? 1 : 0;
    }
  }
  EXPECT_GE(shared, 30);
  EXPECT_LE(wrong, shared / 50);
}

TEST(MapBuilder, AgentsThatNeverMeetStayApart) {
  SyntheticSubmapsOptions options;
  options.agents = {{0, 1.0, 3, 1.5}, {3.0, 4.0, 3, 1.5}};
  const SyntheticMission mission = MakeSyntheticMission(options);
  const auto builder = MakeBuilder();
  IntegrateMission(mission, 0, 99, true, builder.get());
  EXPECT_EQ(builder->snapshot()->components.size(), 2u);
  for (const Closure& closure : *builder->snapshot()->closures) {
    EXPECT_EQ(mission.agent_of_submap[closure.a.value() - 1],
              mission.agent_of_submap[closure.b.value() - 1]);
  }
}

// With and without redundancy.
class RestoredMap : public ::testing::TestWithParam<int> {};

INSTANTIATE_TEST_SUITE_P(WholeSubmaps, RestoredMap, ::testing::Values(80, 0));

TEST_P(RestoredMap, ContinuesLikeTheUndisturbedOne) {
  const SyntheticMission mission = MakeSyntheticMission(ThreeAgents());
  MapBuilderOptions options;
  options.redundancy.whole_submaps = GetParam();
  const auto undisturbed = MakeBuilder(options);
  IntegrateMission(mission, 0, 9, true, undisturbed.get());
  const auto restarted = MakeBuilder(options);
  restarted->Restore(undisturbed->snapshot());
  EXPECT_EQ(restarted->snapshot()->version, undisturbed->snapshot()->version);
  IntegrateMission(mission, 9, 99, true, undisturbed.get());
  IntegrateMission(mission, 9, 99, true, restarted.get());
  const auto a = undisturbed->snapshot();
  const auto b = restarted->snapshot();
  ASSERT_EQ(a->submaps.size(), b->submaps.size());
  EXPECT_EQ(a->components.size(), b->components.size());
  EXPECT_EQ(a->submaps.back()->refined->redundant_keyframes.empty(), GetParam() > 0);
  // Marginal closures may be judged differently: unpublished landmarks start anew.
  EXPECT_NEAR(static_cast<double>(a->closures->size()), static_cast<double>(b->closures->size()),
              2);
  // The scale of a map without metric sensors is free, and drifts by rounding.
  std::vector<Eigen::Vector3d> in_a, in_b;
  for (size_t i = 0; i < a->submaps.size(); ++i) {
    EXPECT_EQ(a->submaps[i]->component, b->submaps[i]->component);
    for (const Rigid3& pose : a->submaps[i]->world_from_camera) in_a.push_back(pose.translation);
    for (const Rigid3& pose : b->submaps[i]->world_from_camera) in_b.push_back(pose.translation);
  }
  EXPECT_LT(AlignedRms(in_a, in_b), 0.002);
}

TEST(MapBuilder, RepeatsToTheLastBit) {
  const SyntheticMission mission = MakeSyntheticMission(ThreeAgents());
  const auto first = MakeBuilder();
  const auto second = MakeBuilder();
  IntegrateMission(mission, 0, 6, true, first.get());
  IntegrateMission(mission, 0, 6, true, second.get());
  const auto a = first->snapshot();
  const auto b = second->snapshot();
  ASSERT_EQ(a->submaps.size(), b->submaps.size());
  for (size_t i = 0; i < a->submaps.size(); ++i) {
    for (size_t k = 0; k < a->submaps[i]->world_from_camera.size(); ++k) {
      EXPECT_EQ(a->submaps[i]->world_from_camera[k].translation,
                b->submaps[i]->world_from_camera[k].translation);
    }
    EXPECT_EQ(a->submaps[i]->landmarks.size(), b->submaps[i]->landmarks.size());
  }
}

TEST(MapBuilder, HoverInTheMiddleDoesNotTearTheMap) {
  SyntheticSubmapsOptions options;
  options.agents = {{0, 1.2, 3, 1.5}, {1.2, 1.9, 2, 0.02}};
  const SyntheticMission mission = MakeSyntheticMission(options);
  const auto builder = MakeBuilder();
  IntegrateMission(mission, 0, 99, true, builder.get());
  for (const auto& state : builder->snapshot()->submaps) {
    for (const Rigid3& pose : state->world_from_camera) {
      EXPECT_TRUE(pose.translation.allFinite());
      EXPECT_LT(pose.translation.norm(), 10);
    }
  }
}

TEST(MapBuilder, MetricSubmapsKeepTheirScale) {
  SyntheticSubmapsOptions options = ThreeAgents();
  options.metric = true;
  const SyntheticMission mission = MakeSyntheticMission(options);
  const auto builder = MakeBuilder();
  IntegrateMission(mission, 0, 99, true, builder.get());
  const auto snapshot = builder->snapshot();
  ASSERT_EQ(snapshot->components.size(), 1u);
  EXPECT_TRUE(snapshot->components[0].metric);
  EXPECT_LT(KeyframeRms(mission, *snapshot, ComponentId(1), false), 0.02);
}

TEST(MapBuilder, QuarantinedSubmapIsKeptAlone) {
  SyntheticSubmapsOptions options;
  const SyntheticMission mission = MakeSyntheticMission(options);
  const auto builder = MakeBuilder();
  IntegrateMission(mission, 0, 2, true, builder.get());
  Submap broken = *mission.submaps[2].submap;
  for (Keyframe& keyframe : broken.keyframes) keyframe.observations.resize(3);
  builder->IntegrateSubmap({SubmapId(3), std::make_shared<Submap>(broken), mission.camera});
  IntegrateMission(mission, 3, 99, true, builder.get());
  const auto snapshot = builder->snapshot();
  ASSERT_EQ(snapshot->submaps.size(), 5u);
  EXPECT_NE(snapshot->submaps[2]->refined->quarantine_reason, "");
  EXPECT_EQ(snapshot->submaps[2]->component, ComponentId(3));
  EXPECT_TRUE(snapshot->submaps[2]->landmarks.empty());
  EXPECT_EQ(snapshot->submaps[3]->component, snapshot->submaps[4]->component);
}

TEST(MapBuilder, InterruptedWorkIsContinued) {
  const SyntheticMission mission = MakeSyntheticMission(SyntheticSubmapsOptions());
  const auto builder = MakeBuilder();
  IntegrateMission(mission, 0, 99, false, builder.get());
  const std::atomic<bool> at_once = true;
  builder->RunBackgroundWork(at_once);
  EXPECT_TRUE(builder->HasBackgroundWork());
  FinishBackgroundWork(builder.get());
  EXPECT_FALSE(builder->HasBackgroundWork());
  EXPECT_LT(KeyframeRms(mission, *builder->snapshot(), ComponentId(1)), 0.012);
}

// Adjusted after every submap, or only when all are there, as a rebuild does.
TEST(MapBuilder, SettledMapDoesNotDependOnWhenItWasAdjusted) {
  const SyntheticMission mission = MakeSyntheticMission(SyntheticSubmapsOptions());
  std::vector<std::vector<Eigen::Vector3d>> centres;
  for (const bool live : {true, false}) {
    const auto builder = MakeBuilder();
    IntegrateMission(mission, 0, 99, live, builder.get());
    FinishBackgroundWork(builder.get());
    EXPECT_TRUE(builder->HasUnsettled());
    builder->SettleCompletely();
    EXPECT_FALSE(builder->HasUnsettled());
    EXPECT_FALSE(builder->HasBackgroundWork());
    centres.emplace_back();
    for (const auto& state : builder->snapshot()->submaps) {
      EXPECT_EQ(state->component, ComponentId(1));
      for (const Rigid3& camera : state->world_from_camera) {
        centres.back().push_back(camera.translation);
      }
    }
  }
  // 2e-5 m before they settle.
  EXPECT_LT(AlignedRms(centres[0], centres[1]), 1e-6);
}

TEST(MapBuilder, SameSubmapTwiceIsIgnored) {
  const SyntheticMission mission = MakeSyntheticMission(SyntheticSubmapsOptions());
  const auto builder = MakeBuilder();
  IntegrateMission(mission, 0, 2, false, builder.get());
  const auto before = builder->snapshot();
  IntegrateMission(mission, 1, 2, false, builder.get());
  EXPECT_EQ(builder->snapshot(), before);
  EXPECT_EQ(builder->stage_times().refine.count, 2);
}

TEST(MapBuilder, OnlyTouchedSubmapsAreNewInASnapshot) {
  SyntheticSubmapsOptions options;
  options.agents = {{0, 1.0, 3, 1.5}, {3.0, 4.0, 3, 1.5}};
  const SyntheticMission mission = MakeSyntheticMission(options);
  const auto builder = MakeBuilder();
  IntegrateMission(mission, 0, 5, true, builder.get());
  const auto before = builder->snapshot();
  IntegrateMission(mission, 5, 6, false, builder.get());
  const auto after = builder->snapshot();
  EXPECT_EQ(after->version, before->version + 1);
  EXPECT_EQ(after->submaps[0], before->submaps[0]);
  EXPECT_EQ(after->submaps[5]->moved_at_version, after->version);
}

}  // namespace
}  // namespace portolan
