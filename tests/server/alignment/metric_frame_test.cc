#include "server/alignment/metric_frame.h"

#include <gtest/gtest.h>

#include <cmath>

#include "server/alignment/map_aligner.h"
#include "server/refinement/submap_refiner.h"
#include "tests/support/synthetic_submaps.h"

namespace portolan {
namespace {

// Multiplies all lengths of a submap.
void Scale(double factor, Submap* submap) {
  for (FramePose& frame : submap->frames) frame.submap_from_camera.translation *= factor;
  for (Keyframe& keyframe : submap->keyframes) {
    keyframe.submap_from_camera.translation *= factor;
    keyframe.covariance.topRows<3>() *= factor;
    keyframe.covariance.leftCols<3>() *= factor;
  }
  for (SubmapLandmark& landmark : submap->landmarks) {
    landmark.point_in_submap *= factor;
    landmark.covariance *= factor * factor;
  }
}

// A mission of five connected submaps; the first `scale_free` of them have a unit of their own and
// know no gravity, the others' metres are wrong by the given factors.
class MetricMission {
 public:
  MetricMission(int scale_free, std::vector<double> metre_errors) {
    SyntheticSubmapsOptions options;
    options.metric = true;
    mission_ = MakeSyntheticMission(options);
    const SubmapRefiner refiner = SubmapRefiner::Create({}).value();
    for (size_t i = 0; i < mission_.submaps.size(); ++i) {
      const SyntheticSubmap& synthetic = mission_.submaps[i];
      Submap raw = *synthetic.submap;
      raw.metric = static_cast<int>(i) >= scale_free;
      if (raw.metric) {
        Scale(metre_errors[i - scale_free], &raw);
        raw.gravity_in_submap = synthetic.world_from_submap.rotation.conjugate() * kGravity;
      } else {
        Scale(1.7, &raw);
      }
      aligner_.AddSubmap(
          refiner.Refine(synthetic.id, std::make_shared<Submap>(raw), mission_.camera));
      aligner_.AdjustAround(synthetic.id);
    }
    while (aligner_.HasBackgroundWork()) aligner_.AdjustStaleComponent(never_);
  }

  const MapModel& model() const { return aligner_.model(); }
  std::vector<SubmapId> ids() const { return model().SubmapsOf(ComponentId(1)); }

  // Length of the way through all submaps in the map over the true one.
  double LengthRatio() const {
    const Eigen::Vector3d way = model().submap(ids().back()).world_from_camera.back().translation -
                                model().submap(ids().front()).world_from_camera.front().translation;
    const Eigen::Vector3d truth = mission_.submaps.back().world_from_camera.back().translation -
                                  mission_.submaps.front().world_from_camera.front().translation;
    return way.norm() / truth.norm();
  }

  double VerticalError_rad() const {
    const ModelSubmap& last = model().submap(ids().back());
    const Eigen::Vector3d down =
        last.world_from_camera.front().rotation *
        (mission_.submaps.back().world_from_camera.front().rotation.conjugate() * kGravity);
    return std::acos(std::min(1.0, -down.z()));
  }

 private:
  const Eigen::Vector3d kGravity = Eigen::Vector3d(0.6, 0, -0.8);
  const std::atomic<bool> never_ = false;
  SyntheticMission mission_;
  MapAligner aligner_{MapAlignerOptions()};
};

TEST(MetricFrame, MetricSubmapsMakeAnOlderScaleFreeMapMetricAndUpright) {
  const MetricMission mission(2, {1, 1, 1});
  ASSERT_EQ(mission.ids().size(), 5u);
  EXPECT_NEAR(mission.LengthRatio(), 1, 0.02);
  EXPECT_LT(mission.VerticalError_rad(), 0.01);
  const Similarity3 rest = MetricFromWorld({}, mission.model(), mission.ids());
  EXPECT_NEAR(rest.scale, 1, 1e-9);
}

TEST(MetricFrame, ErrorsOfTheScalesAreAveragedAndOneWrongOneIsOutvoted) {
  EXPECT_NEAR(MetricMission(0, {1.02, 0.99, 1.01, 0.98, 1.0}).LengthRatio(), 1, 0.015);
  EXPECT_NEAR(MetricMission(0, {1.0, 1.0, 1.5, 1.0, 1.0}).LengthRatio(), 1, 0.03);
}

TEST(MetricFrame, ManyMeasurementsOfOneSessionAreNotIndependent) {
  const MetricMission mission(0, {1, 1, 1, 1, 1});
  const auto together = MeasureScales({}, mission.model(), mission.ids());
  ASSERT_EQ(together.size(), 5u);
  double information = 0, best = 1;
  for (const auto& [id, measurement] : together) {
    information += 1 / (measurement.sigma * measurement.sigma);
    best = std::min(best, MeasureScale({}, mission.model(), id)->sigma);
  }
  EXPECT_GT(1 / std::sqrt(information), 0.99 * best);
}

TEST(MetricFrame, WithoutMetricSubmapsNothingMoves) {
  const MetricMission mission(5, {});
  EXPECT_TRUE(MeasureScales({}, mission.model(), mission.ids()).empty());
  const Similarity3 rest = MetricFromWorld({}, mission.model(), mission.ids());
  EXPECT_EQ(rest.scale, 1);
  EXPECT_EQ(rest.rotation.w(), 1);
  EXPECT_GT(std::abs(mission.LengthRatio() - 1), 0.3);
}

}  // namespace
}  // namespace portolan
