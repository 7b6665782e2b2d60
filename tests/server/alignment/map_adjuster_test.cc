#include "server/alignment/map_adjuster.h"

#include <gtest/gtest.h>

#include <cstdlib>

#include "server/refinement/submap_refiner.h"
#include "tests/support/synthetic_submaps.h"

namespace portolan {
namespace {

// One session of three submaps, adjusted.
class MapAdjusterTest : public ::testing::Test {
 protected:
  // Of the last submap some keyframes may be redundant.
  void Make(const SyntheticSubmapsOptions& options, const std::vector<int>& redundant = {}) {
    const SyntheticMission mission = MakeSyntheticMission(options);
    const SubmapRefiner refiner = SubmapRefiner::Create({}).value();
    std::shared_ptr<const RefinedSubmap> last;
    for (const SyntheticSubmap& submap : mission.submaps) {
      auto refined = std::make_shared<RefinedSubmap>(
          *refiner.Refine(submap.id, submap.submap, mission.camera));
      if (ids_.size() == 2) refined->redundant_keyframes = redundant;
      const auto link =
          last == nullptr ? std::nullopt : std::optional(LinkToPredecessor({}, *last, *refined));
      model_.Add(refined, link);
      ids_.push_back(submap.id);
      truth_.push_back(submap.world_from_camera);
      last = refined;
    }
    ASSERT_EQ(ids_.size(), 3u);
    AdjustMap({}, ids_, 2, nullptr, &model_);
  }

  static SyntheticSubmapsOptions OneSession() {
    SyntheticSubmapsOptions options;
    options.agents = {{0, 1.8, 3, 1.5}};
    return options;
  }

  Eigen::Vector3d CentreOf(size_t submap, size_t keyframe) const {
    return model_.submap(ids_[submap]).world_from_camera[keyframe].translation;
  }

  MapModel model_{MapModelOptions()};
  std::vector<SubmapId> ids_;
  std::vector<std::vector<Rigid3>> truth_;  // parallel
};

// The farthest camera is one of a submap that is placed with a wrong scale. Once that is mended the
// others are where they were.
TEST_F(MapAdjusterTest, TheUnitDoesNotFollowABadlyPlacedSubmap) {
  Make(OneSession());
  const Eigen::Vector3d origin = CentreOf(0, 0);
  const double near = (CentreOf(1, 5) - origin).norm();
  const double far = (CentreOf(2, 9) - origin).norm();
  ASSERT_GT(far, near);
  Similarity3 wrong = model_.submap(ids_[2]).world_from_submap;
  wrong.scale *= 1.3;
  model_.MoveSubmap(ids_[2], wrong);
  const double wrong_far = (CentreOf(2, 9) - origin).norm();
  ASSERT_GT(wrong_far, 1.05 * far);
  AdjustMap({}, ids_, 2, nullptr, &model_);
  EXPECT_NEAR((CentreOf(1, 5) - CentreOf(0, 0)).norm(), near, 0.01 * near);
  EXPECT_NEAR((CentreOf(2, 9) - CentreOf(0, 0)).norm(), far, 0.02 * far);
}

// Sensors have measured it: a world of another unit is put right, not kept.
TEST_F(MapAdjusterTest, TheUnitFollowsMetricSubmaps) {
  SyntheticSubmapsOptions options = OneSession();
  options.metric = true;
  Make(options);
  const ComponentId component = model_.submap(ids_[0]).component;
  model_.MoveComponent(component, component, Similarity3::FromRigid({}, 1.2));
  AdjustMap({}, ids_, 2, nullptr, &model_);
  const double truth = (truth_[2][9].translation - truth_[0][0].translation).norm();
  EXPECT_NEAR((CentreOf(2, 9) - CentreOf(0, 0)).norm(), truth, 0.04 * truth);
}

// What is held tells the unit, and the window comes to it.
TEST_F(MapAdjusterTest, AWindowTakesTheUnitOfWhatIsHeld) {
  Make(OneSession());
  const double step = (CentreOf(2, 9) - CentreOf(2, 4)).norm();
  std::vector<Eigen::Vector3d> held;
  for (size_t k = 0; k < 9; ++k) held.push_back(CentreOf(1, k));
  Similarity3 wrong = model_.submap(ids_[2]).world_from_submap;
  wrong.scale *= 1.3;
  model_.MoveSubmap(ids_[2], wrong);
  AdjustMap({}, {ids_[2]}, 2, nullptr, &model_);
  for (size_t k = 0; k < held.size(); ++k) EXPECT_EQ(CentreOf(1, k), held[k]) << k;
  EXPECT_NEAR((CentreOf(2, 9) - CentreOf(2, 4)).norm(), step, 0.03 * step);
}

// The first keyframe of the submap behind a window is the window's last.
TEST_F(MapAdjusterTest, RedundantKeyframesBehindTheWindowFollow) {
  Make(OneSession(), {1, 2, 4});
  const Eigen::Vector3d first = CentreOf(2, 0);
  Similarity3 wrong = model_.submap(ids_[1]).world_from_submap;
  wrong.scale *= 1.1;
  model_.MoveSubmap(ids_[1], wrong);
  AdjustMap({}, {ids_[1]}, 1, nullptr, &model_);
  ASSERT_GT((CentreOf(2, 0) - first).norm(), 1e-9);
  MapModel carried = model_;
  carried.CarryRedundantKeyframes(ids_[2]);
  for (const size_t k : {1, 2, 4}) {
    EXPECT_EQ(CentreOf(2, k), carried.submap(ids_[2]).world_from_camera[k].translation) << k;
  }
}

struct SettlingCase {
  int max_cameras_anew;
  // Between maps that began differently: of some 4,000 inliers, of the cost and of the cameras'
  // places.
  int differing_inliers;
  double cost_share;
  double distance;
};

// As a small component and as a large one, which costs less and leaves more to chance (11 inliers
// differ if its landmarks are not triangulated anew).
class MapSettlingTest : public MapAdjusterTest, public testing::WithParamInterface<SettlingCase> {};

INSTANTIATE_TEST_SUITE_P(SmallAndLarge, MapSettlingTest,
                         testing::Values(SettlingCase{2000, 0, 1e-3, 5e-4},
                                         SettlingCase{0, 2, 2e-3, 1e-3}));

// Two maps of the same submaps, one of which took a third of what it sees for outliers.
TEST_P(MapSettlingTest, SettlesInOneMapWhateverTheOutliersWere) {
  MapAdjusterOptions options;
  options.max_cameras_anew = GetParam().max_cameras_anew;
  Make(OneSession());
  MapModel other = model_;
  for (const SubmapId id : ids_) {
    const ModelSubmap& submap = other.submap(id);
    for (size_t i = 0; i < submap.landmarks.size(); ++i) {
      for (size_t k = 0; k < submap.sights[i].size(); ++k) {
        if ((i + k) % 3 == 0) other.SetInlier(id, static_cast<int>(i), static_cast<int>(k), false);
      }
    }
  }
  Similarity3 moved = other.submap(ids_[2]).world_from_submap;
  moved.translation += Eigen::Vector3d(0.02, 0, 0.01);
  other.MoveSubmap(ids_[2], moved);
  const auto distance = [&] {
    double largest = 0;
    for (const SubmapId id : ids_) {
      for (size_t k = 0; k < model_.submap(id).world_from_camera.size(); ++k) {
        largest = std::max(largest, (model_.submap(id).world_from_camera[k].translation -
                                     other.submap(id).world_from_camera[k].translation)
                                        .norm());
      }
    }
    return largest;
  };
  ASSERT_GT(distance(), 0.01);
  const MapAdjustment one = SettleMap(options, ids_, nullptr, &model_);
  const MapAdjustment two = SettleMap(options, ids_, nullptr, &other);
  EXPECT_LE(std::abs(one.summary.inlier_count - two.summary.inlier_count),
            GetParam().differing_inliers);
  EXPECT_NEAR(one.summary.final_cost, two.summary.final_cost,
              GetParam().cost_share * one.summary.final_cost);
  EXPECT_LT(distance(), GetParam().distance);
}

TEST_F(MapAdjusterTest, SettlingThatIsInterruptedSaysSo) {
  Make(OneSession());
  const std::vector<Rigid3> before = model_.submap(ids_[1]).world_from_camera;
  const std::atomic<bool> interrupt = true;
  EXPECT_TRUE(SettleMap({}, ids_, &interrupt, &model_).summary.interrupted);
  for (size_t k = 0; k < before.size(); ++k) {
    EXPECT_LT((before[k].translation - CentreOf(1, k)).norm(), 1e-9);
  }
}

TEST(MapAdjusterOptionsTest, LimitsAreChecked) {
  EXPECT_TRUE(MapAdjusterOptions().Validate().ok());
  MapAdjusterOptions options;
  options.settling_damping = 0;
  EXPECT_FALSE(options.Validate().ok());
  options = {};
  options.settling_depth_prior = 0.5;
  EXPECT_FALSE(options.Validate().ok());
  options = {};
  options.bundle.initial_damping = 0;
  EXPECT_FALSE(options.Validate().ok());
}

}  // namespace
}  // namespace portolan
