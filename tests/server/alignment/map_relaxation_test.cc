#include "server/alignment/map_relaxation.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <future>
#include <map>
#include <thread>

#include "server/refinement/submap_refiner.h"
#include "tests/support/synthetic_submaps.h"

namespace portolan {
namespace {

// One session of connected submaps.
class MapRelaxationTest : public ::testing::Test {
 protected:
  void Make(bool metric) {
    SyntheticSubmapsOptions options;
    options.agents = {{0, 3, 6, 1.5}};
    options.metric = metric;
    mission_ = MakeSyntheticMission(options);
    const SubmapRefiner refiner = SubmapRefiner::Create({}).value();
    std::shared_ptr<const RefinedSubmap> predecessor;
    for (const SyntheticSubmap& submap : mission_.submaps) {
      Submap raw = *submap.submap;
      raw.metric = metric;
      auto refined =
          refiner.Refine(submap.id, std::make_shared<const Submap>(raw), mission_.camera);
      std::optional<SubmapRelation> link;
      if (predecessor) link = LinkToPredecessor({}, *predecessor, *refined);
      model_.Add(refined, link);
      predecessor = std::move(refined);
      ids_.push_back(submap.id);
    }
    RelaxSubmaps({}, {}, ids_, nullptr, &model_);
  }

  double Rms() const {
    std::vector<Eigen::Vector3d> estimate, truth;
    for (const auto& [id, submap] : model_.submaps()) {
      for (size_t k = 0; k < submap.world_from_camera.size(); ++k) {
        estimate.push_back(submap.world_from_camera[k].translation);
        truth.push_back(mission_.submaps[id.value() - 1].world_from_camera[k].translation);
      }
    }
    return AlignedRms(estimate, truth);
  }

  // The session turns, moves and grows more and more along its way.
  void Bend() {
    Vector7d step;
    step << 0.02, -0.01, 0.01, 0.003, 0.006, -0.003, 0.03;
    const auto bent = [&step](double place) { return Similarity3::Exp(place * step); };
    std::map<int, Eigen::Vector3d> points;
    std::vector<std::vector<Rigid3>> cameras;
    for (size_t i = 0; i < ids_.size(); ++i) {
      const ModelSubmap& submap = model_.submap(ids_[i]);
      cameras.push_back(submap.world_from_camera);
      const double last = static_cast<double>(cameras[i].size()) - 1;
      for (size_t k = 0; k < cameras[i].size(); ++k) {
        const double place = static_cast<double>(i) + static_cast<double>(k) / last;
        cameras[i][k] = bent(place) * cameras[i][k];
      }
      for (const int landmark : submap.landmarks) {
        const Eigen::Vector3d& point = model_.landmarks()[landmark].point_in_world;
        points.emplace(landmark, bent(static_cast<double>(i) + 0.5) * point);
      }
    }
    for (size_t i = 0; i < ids_.size(); ++i) {
      for (size_t k = 0; k < cameras[i].size(); ++k) {
        if (k == 0 && i > 0) continue;
        model_.SetCamera(ids_[i], static_cast<int>(k), cameras[i][k]);
      }
    }
    for (const auto& [landmark, point] : points) model_.SetLandmark(landmark, point);
    for (const SubmapId id : ids_) model_.FitSubmapToCameras(id);
  }

  std::vector<Eigen::Vector3d> Positions() const {
    std::vector<Eigen::Vector3d> positions;
    for (const SubmapId id : ids_) {
      for (const Rigid3& camera : model_.submap(id).world_from_camera) {
        positions.push_back(camera.translation);
      }
    }
    return positions;
  }

  SyntheticMission mission_;
  std::vector<SubmapId> ids_;
  MapModel model_{MapModelOptions()};
};

TEST_F(MapRelaxationTest, StraightensABentSession) {
  Make(false);
  const double straight = Rms();
  Bend();
  const double bent = Rms();
  EXPECT_GT(bent, 3 * straight);
  MapRelaxationOptions options;
  options.max_iterations = 10;
  const RelaxationSummary summary = RelaxSubmaps(options, {}, ids_, nullptr, &model_);
  EXPECT_LT(summary.final_cost, 0.5 * summary.initial_cost);
  EXPECT_LT(Rms(), 1.2 * straight);
  // The first keyframe is where it was, and neighbours still share theirs.
  for (size_t i = 1; i < ids_.size(); ++i) {
    EXPECT_EQ(model_.submap(ids_[i]).world_from_camera.front().translation,
              model_.submap(ids_[i - 1]).world_from_camera.back().translation);
  }
}

TEST_F(MapRelaxationTest, LeavesARelaxedMapAlone) {
  Make(false);
  const double before = Rms();
  const RelaxationSummary summary = RelaxSubmaps({}, {}, ids_, nullptr, &model_);
  EXPECT_LT(summary.initial_cost - summary.final_cost, 1e-3 * summary.initial_cost);
  EXPECT_NEAR(Rms(), before, 0.1 * before);
}

TEST_F(MapRelaxationTest, FollowsMetricSubmaps) {
  Make(true);
  const auto length = [this] {
    return (model_.submap(ids_.back()).world_from_camera.back().translation -
            model_.submap(ids_.front()).world_from_camera.front().translation)
        .norm();
  };
  const double metres = length();
  Similarity3 larger;
  larger.scale = 1.03;
  model_.MoveComponent(ComponentId(1), ComponentId(1), larger);
  EXPECT_NEAR(length() / metres, 1.03, 1e-9);
  RelaxSubmaps({}, {}, ids_, nullptr, &model_);
  EXPECT_NEAR(length() / metres, 1.0, 0.005);
}

TEST_F(MapRelaxationTest, InterruptedAtOnceChangesNothing) {
  Make(false);
  Bend();
  const std::vector<Eigen::Vector3d> before = Positions();
  const std::atomic<bool> interrupt = true;
  EXPECT_TRUE(RelaxSubmaps({}, {}, ids_, &interrupt, &model_).interrupted);
  EXPECT_EQ(Positions(), before);
}

// At once, and then ever later, so that a build that is slow comes to an end as well. Returns how
// often: once at least, and on a busy machine it may be no more.
int RunInterruptedAgainAndAgain(const MapModel& model, MapRelaxation* relaxation) {
  std::atomic<bool> interrupt = false;
  std::promise<void> started, done;
  std::thread other([&, is_done = done.get_future()] {
    std::chrono::duration<double, std::micro> pause(200);
    interrupt = true;
    started.set_value();
    for (; is_done.wait_for(pause) == std::future_status::timeout; pause *= 1.2) interrupt = true;
  });
  started.get_future().wait();
  int interruptions = 0;
  while (!relaxation->Run(model, &interrupt)) {
    EXPECT_TRUE(relaxation->summary().interrupted);
    ++interruptions;
    interrupt = false;
  }
  done.set_value();
  other.join();
  return interruptions;
}

TEST_F(MapRelaxationTest, InterruptedAgainAndAgainItComesToTheSame) {
  Make(false);
  Bend();
  const MapModel bent = model_;
  MapModel at_once = model_;
  MapRelaxation whole({}, {}, ids_, at_once, nullptr);
  EXPECT_TRUE(whole.Run(at_once, nullptr));
  const auto ends = whole.ApplyTo(&at_once);

  for (int interruptions = 0; interruptions <= 5;) {
    model_ = bent;
    MapRelaxation broken({}, {}, ids_, model_, nullptr);
    const int more = RunInterruptedAgainAndAgain(model_, &broken);
    ASSERT_GT(more, 0);
    interruptions += more;
    EXPECT_FALSE(broken.summary().interrupted);
    EXPECT_EQ(broken.summary().iterations, whole.summary().iterations);
    EXPECT_EQ(broken.summary().initial_cost, whole.summary().initial_cost);
    EXPECT_EQ(broken.summary().final_cost, whole.summary().final_cost);
    const auto broken_ends = broken.ApplyTo(&model_);
    ASSERT_EQ(broken_ends.size(), ends.size());
    for (const auto& [id, end] : ends) {
      EXPECT_EQ(broken_ends.at(id).translation, end.translation);
      for (size_t k = 0; k < model_.submap(id).world_from_camera.size(); ++k) {
        EXPECT_EQ(model_.submap(id).world_from_camera[k].translation,
                  at_once.submap(id).world_from_camera[k].translation);
      }
    }
    for (size_t i = 0; i < model_.landmarks().size(); ++i) {
      EXPECT_EQ(model_.landmarks()[i].point_in_world, at_once.landmarks()[i].point_in_world);
    }
  }
}

// What is moved while a relaxation goes on, even before it has seen a landmark, is not what it
// relaxes.
TEST_F(MapRelaxationTest, ItRelaxesTheMapAsItBegan) {
  Make(false);
  Bend();
  MapRelaxation undisturbed({}, {}, ids_, model_, nullptr);
  EXPECT_TRUE(undisturbed.Run(model_, nullptr));
  MapRelaxation disturbed({}, {}, ids_, model_, nullptr);
  const std::atomic<bool> at_once = true;
  EXPECT_FALSE(disturbed.Run(model_, &at_once));
  const Vector7d step = 0.3 * Vector7d::Ones();
  for (const SubmapId id : {ids_[1], ids_[2]}) {
    model_.MoveSubmap(id, model_.submap(id).world_from_submap * Similarity3::Exp(step));
  }
  EXPECT_TRUE(disturbed.Run(model_, nullptr));
  EXPECT_EQ(disturbed.summary().initial_cost, undisturbed.summary().initial_cost);
  EXPECT_EQ(disturbed.summary().final_cost, undisturbed.summary().final_cost);
}

TEST(MapRelaxationOptions, RefusesNonsense) {
  MapRelaxationOptions options;
  EXPECT_TRUE(options.Validate().ok());
  options.loss_scale_sigmas = 0;
  EXPECT_FALSE(options.Validate().ok());
}

}  // namespace
}  // namespace portolan
