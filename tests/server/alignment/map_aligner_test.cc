#include "server/alignment/map_aligner.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>

#include "server/refinement/submap_refiner.h"
#include "tests/support/synthetic_submaps.h"

namespace portolan {
namespace {

class MapAlignerTest : public ::testing::Test {
 protected:
  void Make(const SyntheticSubmapsOptions& options) {
    mission_ = MakeSyntheticMission(options);
    const SubmapRefiner refiner = SubmapRefiner::Create({}).value();
    for (const SyntheticSubmap& submap : mission_.submaps) {
      refined_.push_back(refiner.Refine(submap.id, submap.submap, mission_.camera));
    }
  }

  static SyntheticSubmapsOptions TwoAgents() {
    SyntheticSubmapsOptions options;
    options.agents = {{0, 1.5, 3, 1.5}, {0.3, 1.8, 3, 1.4}};
    return options;
  }

  void AddAll() {
    for (const auto& refined : refined_) aligner_.AddSubmap(refined);
  }

  // Between submaps a and b (from 1), from the truth, distorted by `error`; the matches are true
  // unless there is an error.
  Closure MakeClosure(int a, int b, const Vector7d& error = Vector7d::Zero(),
                      size_t max_matches = 1000) const {
    Closure closure;
    closure.a = SubmapId(a);
    closure.b = SubmapId(b);
    closure.a_from_b = mission_.submaps[a - 1].world_from_submap.Inverse() *
                       mission_.submaps[b - 1].world_from_submap * Similarity3::Exp(error);
    closure.information = 1e4 * Matrix7d::Identity();
    const auto& points_a = mission_.point_ids_of_tracks[mission_.agent_of_submap[a - 1]];
    const auto& points_b = mission_.point_ids_of_tracks[mission_.agent_of_submap[b - 1]];
    const int shift = error.isZero() ? 0 : 1;
    for (const RefinedLandmark& in_a : refined_[a - 1]->landmarks) {
      for (const RefinedLandmark& in_b : refined_[b - 1]->landmarks) {
        if (closure.matches.size() >= max_matches) break;
        const bool same = points_a.at(in_a.track) == points_b.at(in_b.track) + shift * 7;
        if (same || (shift != 0 && in_a.track.value() % 97 == in_b.track.value() % 89)) {
          closure.matches.push_back({in_a.track, in_b.track});
        }
      }
    }
    return closure;
  }

  void Polish() {
    const std::atomic<bool> never = false;
    while (aligner_.HasBackgroundWork()) aligner_.AdjustStaleComponent(never);
  }

  // Of the submaps from the first one.
  std::vector<double> Distances() const {
    std::vector<double> distances;
    const Eigen::Vector3d origin =
        aligner_.model().submap(SubmapId(1)).world_from_submap.translation;
    for (const auto& [id, submap] : aligner_.model().submaps()) {
      if (id == SubmapId(1)) continue;
      distances.push_back((submap.world_from_submap.translation - origin).norm());
    }
    return distances;
  }

  // The median factor by which distances grew; some others, or nothing is tested.
  static double GrowthOfMost(const std::vector<double>& before, const std::vector<double>& after) {
    std::vector<double> ratios;
    for (size_t i = 0; i < before.size(); ++i) ratios.push_back(after[i] / before[i]);
    std::sort(ratios.begin(), ratios.end());
    EXPECT_GT(ratios.back() - ratios.front(), 2e-3);
    return ratios[ratios.size() / 2];
  }

  double Rms() const {
    std::vector<Eigen::Vector3d> estimate, truth;
    for (const auto& [id, submap] : aligner_.model().submaps()) {
      if (submap.component != ComponentId(1)) continue;
      for (size_t k = 0; k < submap.world_from_camera.size(); ++k) {
        estimate.push_back(submap.world_from_camera[k].translation);
        truth.push_back(mission_.submaps[id.value() - 1].world_from_camera[k].translation);
      }
    }
    return AlignedRms(estimate, truth);
  }

  SyntheticMission mission_;
  std::vector<std::shared_ptr<const RefinedSubmap>> refined_;
  MapAligner aligner_{MapAlignerOptions()};
};

TEST_F(MapAlignerTest, AdjustmentGainsOnTheLinksAlone) {
  SyntheticSubmapsOptions options;
  options.agents = {{0, 3, 6, 1.5}};
  double linked = 0;
  double adjusted = 0;
  for (options.seed = 1; options.seed <= 5; ++options.seed) {
    aligner_ = MapAligner(MapAlignerOptions());
    refined_.clear();
    Make(options);
    AddAll();
    linked += Rms();
    Polish();
    adjusted += Rms();
    EXPECT_LT(Rms(), 0.012) << options.seed;
  }
  EXPECT_LT(adjusted, 0.8 * linked);
}

TEST_F(MapAlignerTest, OneStrongClosureJoinsComponents) {
  Make(TwoAgents());
  AddAll();
  EXPECT_EQ(aligner_.model().SubmapsOf(ComponentId(1)).size(), 3u);
  aligner_.AddClosures({MakeClosure(1, 2)});
  EXPECT_EQ(aligner_.model().SubmapsOf(ComponentId(1)).size(), 6u);
  Polish();
  EXPECT_LT(Rms(), 0.01);
}

TEST_F(MapAlignerTest, WeakClosureWaitsForASecondThatAgrees) {
  Make(TwoAgents());
  AddAll();
  aligner_.AddClosures({MakeClosure(1, 2, Vector7d::Zero(), 15)});
  EXPECT_EQ(aligner_.model().SubmapsOf(ComponentId(1)).size(), 3u);
  aligner_.AddClosures({MakeClosure(3, 4, Vector7d::Zero(), 15)});
  EXPECT_EQ(aligner_.model().SubmapsOf(ComponentId(1)).size(), 6u);
  EXPECT_EQ(aligner_.closures().size(), 2u);
}

TEST_F(MapAlignerTest, ContradictingWeakClosuresJoinNothing) {
  Make(TwoAgents());
  AddAll();
  Vector7d error;
  error << 1, 0, 0.5, 0.4, 0, 0, 0.2;
  aligner_.AddClosures({MakeClosure(1, 2, Vector7d::Zero(), 15), MakeClosure(3, 4, error, 15)});
  EXPECT_TRUE(aligner_.closures().empty());
  EXPECT_EQ(aligner_.model().SubmapsOf(ComponentId(1)).size(), 3u);
}

TEST_F(MapAlignerTest, FalseLoopIsRefused) {
  SyntheticSubmapsOptions options;
  options.agents = {{0, 3, 6, 1.5}};
  Make(options);
  AddAll();
  Polish();
  const double before = Rms();
  Vector7d error;
  error << 1, 0, 0.5, 0.8, 0, 0, 0.2;
  aligner_.AddClosures({MakeClosure(1, 6, error, 30)});
  Polish();
  EXPECT_TRUE(aligner_.closures().empty());
  EXPECT_NEAR(Rms(), before, 1e-4);
}

TEST_F(MapAlignerTest, WrongMergeIsUndone) {
  SyntheticSubmapsOptions options = TwoAgents();
  options.agents[1] = {3.0, 4.5, 3, 1.4};  // sees another wall
  Make(options);
  AddAll();
  Polish();
  Vector7d error;
  error << 0.3, 0, 0.1, 0.1, 0, 0, 0.1;
  Closure wrong = MakeClosure(1, 2, error, 60);
  wrong.a_from_b = Similarity3::Identity();
  ASSERT_GE(wrong.matches.size(), 40u);
  aligner_.AddClosures({wrong});
  EXPECT_EQ(aligner_.model().SubmapsOf(ComponentId(1)).size(), 6u);
  Polish();
  EXPECT_TRUE(aligner_.closures().empty());
  EXPECT_EQ(aligner_.model().SubmapsOf(ComponentId(1)).size(), 3u);
  EXPECT_EQ(aligner_.model().SubmapsOf(ComponentId(2)).size(), 3u);
  Polish();
  EXPECT_LT(Rms(), 0.01);
}

// As a wrong closure may leave them: everything that they see is an outlier.
TEST_F(MapAlignerTest, KeyframesThatWerePulledAwayGoBack) {
  SyntheticSubmapsOptions options;
  options.agents = {{0, 1.5, 3, 1.5}};
  Make(options);
  AddAll();
  Polish();
  ASSERT_LT(Rms(), 0.01);
  const MapModel model = aligner_.model();
  aligner_ = MapAligner(MapAlignerOptions());
  const Rigid3 away(Eigen::Quaterniond(Eigen::AngleAxisd(0.7, Eigen::Vector3d::UnitY())),
                    {1.5, -0.4, 0.9});
  for (const auto& [id, submap] : model.submaps()) {
    PlacedSubmap placed{submap.refined, submap.component, submap.world_from_submap,
                        submap.world_from_camera, submap.camera};
    if (id == SubmapId(2)) {
      for (const int k : {1, 2, 4})
        placed.world_from_camera[k] = away * placed.world_from_camera[k];
    }
    aligner_.RestoreSubmap(placed);
  }
  for (const ModelLandmark& landmark : model.landmarks()) aligner_.RestoreLandmark(landmark);
  ASSERT_GT(Rms(), 0.1);
  Polish();
  EXPECT_LT(Rms(), 0.01);
}

TEST_F(MapAlignerTest, WrongMergeGivesWayToClosuresThatAgree) {
  Make(TwoAgents());
  AddAll();
  Vector7d error;
  error << 1, 0, 0.5, 0.4, 0, 0, 0.2;
  Closure wrong = MakeClosure(1, 6, error, 60);
  ASSERT_GE(wrong.matches.size(), 40u);
  aligner_.AddClosures({wrong});
  EXPECT_EQ(aligner_.model().SubmapsOf(ComponentId(1)).size(), 6u);
  Polish();
  aligner_.AddClosures({MakeClosure(1, 2)});
  aligner_.AddClosures({MakeClosure(3, 4)});
  EXPECT_EQ(aligner_.model().SubmapsOf(ComponentId(1)).size(), 6u);
  ASSERT_EQ(aligner_.closures().size(), 2u);
  for (const Closure& closure : aligner_.closures()) EXPECT_NE(closure.b, SubmapId(6));
  Polish();
  EXPECT_LT(Rms(), 0.01);
}

// Repeated structure: two wrong closures that agree come first.
TEST_F(MapAlignerTest, AgreeingWrongClosuresAreOutvoted) {
  Make(TwoAgents());
  AddAll();
  Vector7d error;
  error << 0.8, 0, 0.3, 0.3, 0, 0, 0;
  Closure first = MakeClosure(1, 2, error, 30);
  Closure second = MakeClosure(3, 4, error, 30);
  const auto& truth = mission_.submaps;
  second.a_from_b = truth[2].world_from_submap.Inverse() * truth[0].world_from_submap *
                    first.a_from_b * truth[1].world_from_submap.Inverse() *
                    truth[3].world_from_submap;
  aligner_.AddClosures({first, second});
  EXPECT_EQ(aligner_.closures().size(), 2u);
  aligner_.AddClosures({MakeClosure(1, 4), MakeClosure(3, 2), MakeClosure(3, 6)});
  ASSERT_EQ(aligner_.closures().size(), 3u);
  Polish();
  EXPECT_EQ(aligner_.closures().size(), 3u);
  EXPECT_LT(Rms(), 0.01);
}

TEST_F(MapAlignerTest, CovarianceGrowsAlongTheChain) {
  SyntheticSubmapsOptions options;
  options.agents = {{0, 3, 6, 1.5}};
  Make(options);
  AddAll();
  EXPECT_EQ(aligner_.Covariance(SubmapId(1)).norm(), 0);
  EXPECT_GT(aligner_.Covariance(SubmapId(2)).trace(), 0);
  EXPECT_GT(aligner_.Covariance(SubmapId(6))(6, 6), aligner_.Covariance(SubmapId(2))(6, 6));
}

// A submap that comes while a relaxation is interrupted moves with its predecessor's end.
TEST_F(MapAlignerTest, SubmapThatCameDuringARelaxationKeepsItsShape) {
  SyntheticSubmapsOptions world;
  world.agents = {{0, 3, 6, 1.5}};
  Make(world);
  MapAlignerOptions options;
  options.full_component_submaps = 3;
  options.region_submaps = 1;
  aligner_ = MapAligner(options);
  for (size_t i = 0; i + 1 < refined_.size(); ++i) aligner_.AddSubmap(refined_[i]);
  const std::atomic<bool> at_once = true;
  aligner_.AdjustStaleComponent(at_once);  // begins the relaxation
  aligner_.AddSubmap(refined_.back());
  const std::vector<Rigid3> before = aligner_.model().submap(SubmapId(6)).world_from_camera;
  const std::atomic<bool> never = false;
  aligner_.AdjustStaleComponent(never);
  const std::vector<Rigid3>& after = aligner_.model().submap(SubmapId(6)).world_from_camera;
  const auto length = [](const std::vector<Rigid3>& cameras, size_t from) {
    return (cameras[from + 1].translation - cameras[from].translation).norm();
  };
  EXPECT_GT((after[0].translation - before[0].translation).norm(), 0.1 * length(before, 0));
  for (size_t i = 1; i + 1 < after.size(); ++i) {
    EXPECT_NEAR(length(after, i) / length(after, 0), length(before, i) / length(before, 0), 1e-6);
  }
  EXPECT_EQ(aligner_.model().submap(SubmapId(5)).world_from_camera.back().translation,
            after.front().translation);
}

// What new submaps may spend on solving is bounded; closures beyond that wait for the background.
TEST_F(MapAlignerTest, ClosuresBeyondTheCreditWaitForTheBackground) {
  SyntheticSubmapsOptions world;
  world.agents = {{0, 3, 10, 1.5}};
  Make(world);
  MapAlignerOptions options;
  options.full_component_submaps = 3;
  options.relations = {0.002, 0.002, 0.002, 3000};
  // Each contradicts the map by more than its own uncertainty, but not by more than the chain's.
  Vector7d error = Vector7d::Zero();
  error[6] = 0.03;
  Closure first = MakeClosure(1, 5, error);
  error[6] = 0.005;
  Closure second = MakeClosure(5, 10, error);
  first.information = second.information = 1e6 * Matrix7d::Identity();
  const auto feed = [&](int credit) {
    options.solving_credit_submaps = credit;
    aligner_ = MapAligner(options);
    AddAll();
    aligner_.AddClosures({first, second});
    return aligner_.closures().size();
  };
  EXPECT_EQ(feed(1000), 2u);
  EXPECT_EQ(feed(1), 1u);
  ASSERT_EQ(aligner_.waiting_closures().size(), 1u);
  const std::atomic<bool> at_once = true;
  // The next submap has nothing to spend, either; in the end the background needs no credit.
  aligner_.AddClosures({});
  EXPECT_EQ(aligner_.waiting_closures().size(), 1u);
  aligner_.AdjustStaleComponent(at_once);
  EXPECT_EQ(aligner_.waiting_closures().size(), 1u);
  // Regions come first.
  aligner_.AdjustStaleComponent(false);
  EXPECT_EQ(aligner_.waiting_closures().size(), 1u);
  Polish();
  EXPECT_EQ(aligner_.waiting_closures().size(), 0u);
}

// A closure finds a chain whose scale has drifted. The graph, of a small component or of all of a
// large one, holds the first submap; metric or not, most submaps stay as far from it as they were.
TEST_F(MapAlignerTest, AClosureKeepsTheUnit) {
  SyntheticSubmapsOptions world;
  world.agents = {{0, 3, 10, 1.5}};
  for (const bool metric : {false, true}) {
    world.metric = metric;
    refined_.clear();
    Make(world);
    Vector7d error = Vector7d::Zero();
    error[6] = metric ? 0.012 : 0.03;
    Closure closure = MakeClosure(1, 5, error);
    closure.information = 1e6 * Matrix7d::Identity();
    for (const int full : {80, 3}) {
      SCOPED_TRACE(testing::Message() << metric << " " << full);
      MapAlignerOptions options;
      options.full_component_submaps = full;
      options.relations = {0.002, 0.002, 0.002, 3000};
      aligner_ = MapAligner(options);
      AddAll();
      const std::vector<double> before = Distances();
      aligner_.AddClosures({closure});
      ASSERT_EQ(aligner_.closures().size(), 1u);
      // Submaps that moved by less than 1e-4 of their size were left where they were.
      EXPECT_NEAR(GrowthOfMost(before, Distances()), 1, full == 3 ? 2e-4 : 1e-9);
    }
  }
}

// Two sessions, metric each, are joined by a wrong closure and come apart again. One that waits
// between them agrees with where they lie then, by chance: that unites nothing, for they are two
// worlds.
TEST_F(MapAlignerTest, ClosureBetweenPartsThatCameApartWaits) {
  SyntheticSubmapsOptions world;
  world.metric = true;
  world.agents = {{0, 2.5, 5, 1.5}, {3.2, 5.7, 5, 1.4}};
  Make(world);
  MapAlignerOptions options;
  options.full_component_submaps = 3;
  Vector7d error;
  error << 0.3, 0, 0.1, 0.1, 0, 0, 0.1;
  Closure wrong = MakeClosure(1, 2, error, 60);
  wrong.a_from_b = Similarity3::Exp(0.8 * Vector7d::Unit(6));
  ASSERT_GE(wrong.matches.size(), 40u);
  Closure late = MakeClosure(5, 6, error, 15);
  const auto run = [&] {
    aligner_ = MapAligner(options);
    AddAll();
    aligner_.AddClosures({wrong});
    EXPECT_EQ(aligner_.model().SubmapsOf(ComponentId(1)).size(), 10u);
    aligner_.AddClosures({late});
    EXPECT_EQ(aligner_.waiting_closures().size(), 1u);
    Polish();
    EXPECT_EQ(aligner_.model().SubmapsOf(ComponentId(1)).size(), 5u);
  };
  run();
  const MapModel& model = aligner_.model();
  late.a_from_b =
      model.submap(late.a).world_from_submap.Inverse() * model.submap(late.b).world_from_submap;
  run();
  EXPECT_TRUE(aligner_.closures().empty());
  // So does the wrong one, for a second chance.
  EXPECT_EQ(aligner_.waiting_closures().size(), 2u);
}

TEST_F(MapAlignerTest, TouchedSubmapsAreReportedOnce) {
  Make(TwoAgents());
  aligner_.AddSubmap(refined_[0]);
  EXPECT_EQ(aligner_.TakeTouched(), std::set<SubmapId>{SubmapId(1)});
  EXPECT_TRUE(aligner_.TakeTouched().empty());
}

}  // namespace
}  // namespace portolan
