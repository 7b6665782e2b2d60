#include "server/alignment/map_adjuster.h"

#include <gtest/gtest.h>

#include "server/refinement/submap_refiner.h"
#include "tests/support/synthetic_submaps.h"

namespace portolan {
namespace {

// One session of three submaps, adjusted.
class MapAdjusterTest : public ::testing::Test {
 protected:
  MapAdjusterTest() {
    options_.agents = {{0, 1.8, 3, 1.5}};
    const SyntheticMission mission = MakeSyntheticMission(options_);
    const SubmapRefiner refiner = SubmapRefiner::Create({}).value();
    std::shared_ptr<const RefinedSubmap> last;
    for (const SyntheticSubmap& submap : mission.submaps) {
      const auto refined = refiner.Refine(submap.id, submap.submap, mission.camera);
      const auto link =
          last == nullptr ? std::nullopt : std::optional(LinkToPredecessor({}, *last, *refined));
      model_.Add(refined, link);
      ids_.push_back(submap.id);
      last = refined;
    }
    AdjustMap({}, ids_, 2, nullptr, &model_);
  }

  Eigen::Vector3d CentreOf(size_t submap, size_t keyframe) const {
    return model_.submap(ids_[submap]).world_from_camera[keyframe].translation;
  }

  SyntheticSubmapsOptions options_;
  MapModel model_{MapModelOptions()};
  std::vector<SubmapId> ids_;
};

// The farthest camera is one of a submap that is placed with a wrong scale. Once that is mended the
// others are where they were.
TEST_F(MapAdjusterTest, TheUnitDoesNotFollowABadlyPlacedSubmap) {
  ASSERT_EQ(ids_.size(), 3u);
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

}  // namespace
}  // namespace portolan
