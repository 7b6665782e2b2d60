#include "server/corrections/offer_planner.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>

#include "tests/server/corrections/wall_state.h"

namespace portolan {
namespace {

// Two agents before the same wall: `a` is offered what `b` sees.
class OfferPlannerTest : public ::testing::Test {
 protected:
  OfferPlannerTest() {
    snapshot_.version = 1;
    own_.push_back(Add("a", 1, Rigid3()));
    Add("b", 2, {Eigen::Quaterniond(RotationExp({0, 0.1, 0})), {0.3, 0, 0}});
  }

  std::shared_ptr<const SubmapState> Add(const std::string& agent, int64_t id,
                                         const Rigid3& world_from_camera) {
    snapshot_.submaps.push_back(testing::MakeWallState(agent, id, world_from_camera));
    return snapshot_.submaps.back();
  }
  // Replaces the submap of `b`.
  void Change(const std::function<void(SubmapState*)>& change) {
    auto state = std::make_shared<SubmapState>(*snapshot_.submaps[1]);
    change(state.get());
    snapshot_.submaps[1] = std::move(state);
  }
  std::vector<LandmarkOffer> Next(double time_s) {
    return planner_.Next(own_, snapshot_, live_pose_, FromSeconds(time_s));
  }
  // Over so many seconds, two rounds a second; returns how many landmarks came.
  size_t Drain(double from_s, double to_s) {
    size_t landmarks = 0;
    for (double time = from_s; time < to_s; time += 0.5) {
      for (const LandmarkOffer& offer : Next(time)) landmarks += offer.landmarks.size();
    }
    return landmarks;
  }

  OfferOptions options_;
  SubmapDepths depths_;
  OfferPlanner planner_{options_, 1000, &depths_};
  OfferPlanner::States own_;
  MapSnapshot snapshot_;
  std::optional<LivePose> live_pose_;
};

TEST_F(OfferPlannerTest, OffersLandmarksOfOthersInTheirPlaces) {
  const std::vector<LandmarkOffer> offers = Next(0);
  ASSERT_EQ(offers.size(), 1u);
  EXPECT_EQ(offers[0].component, ComponentId(1));
  EXPECT_EQ(offers[0].first_index, 0u);
  EXPECT_EQ(offers[0].landmarks.size(), static_cast<size_t>(options_.max_landmarks));
  const SubmapState& state = *snapshot_.submaps[1];
  for (const OfferedLandmark& landmark : offers[0].landmarks) {
    const Eigen::Vector3d point = offers[0].world_from_camera * landmark.point_in_camera;
    double nearest = HUGE_VAL;
    for (const FusedLandmark& fused : state.landmarks) {
      nearest = std::min(nearest, (fused.point_in_world - point).norm());
    }
    EXPECT_LT(nearest, 1e-9);
    // 0.02 at a distance of some 5.
    EXPECT_NEAR(landmark.depth_sigma, 0.004, 0.002);
  }
}

TEST_F(OfferPlannerTest, OffersEachLandmarkOnceAndNumbersThem) {
  uint32_t landmarks = 0;
  for (int i = 0; i < 20; ++i) {
    for (const LandmarkOffer& offer : Next(10.0 * i)) {
      EXPECT_EQ(offer.first_index, landmarks);
      landmarks += static_cast<uint32_t>(offer.landmarks.size());
    }
  }
  EXPECT_LE(landmarks, static_cast<uint32_t>(testing::kWallLandmarks));
  EXPECT_GT(landmarks, static_cast<uint32_t>(testing::kWallLandmarks - options_.min_landmarks));
}

TEST_F(OfferPlannerTest, KeepsWithinTheBudget) {
  for (int64_t id = 3; id < 40; ++id) Add("b", id, {Eigen::Quaterniond::Identity(), {0, 0, 0}});
  const size_t landmarks = Drain(0, 10);
  EXPECT_GT(landmarks, 100u);
  EXPECT_LT(32.0 * static_cast<double>(landmarks),
            options_.burst_bytes + 10 * options_.bytes_per_second + 32 * options_.max_landmarks);
}

TEST_F(OfferPlannerTest, AnAgentThatWantsLessGetsLess) {
  OfferPlanner none(options_, 0, &depths_);
  EXPECT_TRUE(none.Next(own_, snapshot_, live_pose_, FromSeconds(1)).empty());
}

TEST_F(OfferPlannerTest, LeavesOutWhatTheAgentHasItself) {
  Change([](SubmapState* state) {
    for (FusedLandmark& landmark : state->landmarks) {
      landmark.sights.push_back({SubmapId(1), TrackId(1000)});
    }
  });
  EXPECT_EQ(Drain(0, 10), 0u);
}

TEST_F(OfferPlannerTest, LeavesOutOtherComponentsAndOtherDirections) {
  Change([](SubmapState* state) { state->component = ComponentId(9); });
  EXPECT_EQ(Drain(0, 10), 0u);
  Change([](SubmapState* state) { state->component = ComponentId(1); });
  // The agent has turned round.
  live_pose_.emplace();
  live_pose_->submap_from_camera.rotation = RotationExp({0, 3, 0});
  EXPECT_EQ(Drain(10, 20), 0u);
  live_pose_->submap_from_camera.rotation = RotationExp({0, 0.1, 0});
  EXPECT_GT(Drain(20, 30), 20u);
}

TEST_F(OfferPlannerTest, TellsAViewThatHasMovedAgain) {
  EXPECT_GT(Drain(0, 60), 0u);
  EXPECT_TRUE(Next(61).empty());
  Change([](SubmapState* state) {
    for (Rigid3& pose : state->world_from_camera) pose.translation.x() += 0.1;
    for (FusedLandmark& landmark : state->landmarks) landmark.point_in_world.x() += 0.1;
  });
  const std::vector<LandmarkOffer> offers = Next(62);
  ASSERT_EQ(offers.size(), 1u);
  EXPECT_TRUE(offers[0].landmarks.empty());
  EXPECT_NEAR(offers[0].world_from_camera.translation.x(), 0.4, 1e-9);
  EXPECT_TRUE(Next(63).empty());
}

TEST_F(OfferPlannerTest, PredictsTheCameraFromTheOpenSubmap) {
  LivePose live;
  live.sequence_number = 1;
  live.submap_from_camera.translation = {0, 0.5, 0};
  live.predecessor_from_submap = Rigid3();
  // The last keyframe of `a` is at x = 2 in the world, whose unit is half of the submap's.
  const Eigen::Vector3d expected(2, 1, 0);
  EXPECT_LT((PredictCamera(own_, live).translation - expected).norm(), 1e-12);
  live.sequence_number = 5;
  EXPECT_LT((PredictCamera(own_, live).translation - Eigen::Vector3d(2, 0, 0)).norm(), 1e-12);
  EXPECT_LT((PredictCamera(own_, std::nullopt).translation - Eigen::Vector3d(2, 0, 0)).norm(),
            1e-12);
}

// The agent forgets as well: a landmark of a forgotten view is offered again.
TEST_F(OfferPlannerTest, ForgetsTheViewsToldFirst) {
  options_.max_views = options_.max_told_views = 1;
  OfferPlanner forgetful(options_, 1000, &depths_);
  const auto landmarks = [&](OfferPlanner* planner, double from_s, double to_s) {
    size_t count = 0;
    for (double time = from_s; time < to_s; time += 0.5) {
      for (const auto& offer : planner->Next(own_, snapshot_, live_pose_, FromSeconds(time))) {
        count += offer.landmarks.size();
      }
    }
    return count;
  };
  const size_t all = landmarks(&forgetful, 0, 60);
  EXPECT_EQ(landmarks(&planner_, 0, 60), all);
  // Another view of the same comes, which is nearer; then it goes.
  const auto alone = snapshot_.submaps;
  Add("c", 3, {Eigen::Quaterniond(RotationExp({0, 0.01, 0})), {0.02, 0, 0}});
  landmarks(&forgetful, 60, 120);
  landmarks(&planner_, 60, 120);
  snapshot_.submaps = alone;
  EXPECT_EQ(landmarks(&forgetful, 120, 180), all);
  EXPECT_EQ(landmarks(&planner_, 120, 180), 0u);
}

TEST(OfferOptions, RefusesWhatMakesNoSense) {
  OfferOptions options;
  EXPECT_TRUE(options.Validate().ok());
  options.max_landmarks = 257;
  EXPECT_FALSE(options.Validate().ok());
  options = OfferOptions();
  options.bytes_per_second = -1;
  EXPECT_FALSE(options.Validate().ok());
  options = OfferOptions();
  options.max_told_views = options.max_views - 1;
  EXPECT_FALSE(options.Validate().ok());
}

}  // namespace
}  // namespace portolan
