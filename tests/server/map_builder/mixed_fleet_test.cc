// Vehicles with metric sensors and vehicles with a camera alone, in one map.
#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "server/map_builder.h"
#include "tests/support/synthetic_map.h"

namespace portolan {
namespace {

constexpr double kMonocularUnit = 1.7;

void MakeMonocular(Submap* submap) {
  submap->metric = false;
  for (FramePose& frame : submap->frames) frame.submap_from_camera.translation *= kMonocularUnit;
  for (Keyframe& keyframe : submap->keyframes) {
    keyframe.submap_from_camera.translation *= kMonocularUnit;
    keyframe.covariance.topRows<3>() *= kMonocularUnit;
    keyframe.covariance.leftCols<3>() *= kMonocularUnit;
  }
  for (SubmapLandmark& landmark : submap->landmarks) {
    landmark.point_in_submap *= kMonocularUnit;
    landmark.covariance *= kMonocularUnit * kMonocularUnit;
  }
}

// Three vehicles whose ways overlap; those named are metric and know the vertical.
SyntheticMission MakeFleet(const std::set<int>& metric_agents) {
  SyntheticSubmapsOptions options;
  options.agents = {{0, 2.6, 5, 1.5}, {2.0, 4.6, 5, 1.4}, {4.0, 6.9, 5, 1.6}};
  options.metric = true;
  SyntheticMission mission = MakeSyntheticMission(options);
  for (size_t i = 0; i < mission.submaps.size(); ++i) {
    SyntheticSubmap& synthetic = mission.submaps[i];
    Submap raw = *synthetic.submap;
    if (metric_agents.contains(mission.agent_of_submap[i])) {
      raw.gravity_in_submap =
          synthetic.world_from_submap.rotation.conjugate() * -Eigen::Vector3d::UnitZ();
    } else {
      MakeMonocular(&raw);
    }
    synthetic.submap = std::make_shared<const Submap>(std::move(raw));
  }
  return mission;
}

// Size of the map over the true one: the mean distance of the keyframes from their centre.
double ScaleError(const SyntheticMission& mission, const MapSnapshot& snapshot) {
  std::vector<Eigen::Vector3d> map, truth;
  for (const auto& state : snapshot.submaps) {
    const SyntheticSubmap& synthetic = mission.submaps[state->refined->id.value() - 1];
    for (size_t k = 0; k < state->world_from_camera.size(); ++k) {
      map.push_back(state->world_from_camera[k].translation);
      truth.push_back(synthetic.world_from_camera[k].translation);
    }
  }
  const auto size_of = [](const std::vector<Eigen::Vector3d>& points) {
    Eigen::Vector3d center = Eigen::Vector3d::Zero();
    for (const Eigen::Vector3d& point : points) center += point;
    center /= static_cast<double>(points.size());
    double sum = 0;
    for (const Eigen::Vector3d& point : points) sum += (point - center).norm();
    return sum;
  };
  return size_of(map) / size_of(truth) - 1;
}

class MixedFleet : public ::testing::TestWithParam<std::set<int>> {};

TEST_P(MixedFleet, EndsInOneMetricMap) {
  const SyntheticMission mission = MakeFleet(GetParam());
  const auto builder = std::move(MapBuilder::Create({})).value();
  IntegrateMission(mission, 0, 99, false, builder.get());
  builder->SettleCompletely();
  const auto snapshot = builder->snapshot();
  ASSERT_EQ(snapshot->components.size(), 1u);
  const ComponentState& component = snapshot->components[0];
  EXPECT_TRUE(component.metric);
  EXPECT_TRUE(component.gravity_aligned);
  const double scale_error = ScaleError(mission, *snapshot);
  const double rms = KeyframeRms(mission, *snapshot, component.id, false);
  std::printf("scale error %.2f %%, rms without a scale %.1f mm\n", 100 * scale_error, 1e3 * rms);
  EXPECT_LT(std::abs(scale_error), 0.01);
  EXPECT_LT(rms, 0.02);
  ASSERT_TRUE(component.georeference);
  EXPECT_FALSE(component.georeference->is_georeferenced);
  EXPECT_EQ(component.georeference->metric_submap_count, 5 * static_cast<int>(GetParam().size()));
  EXPECT_EQ(component.georeference->vertical_submap_count, 5 * static_cast<int>(GetParam().size()));
  EXPECT_LT(component.georeference->rms_log_scale, 0.02);
  EXPECT_LT(component.georeference->rms_tilt_rad, 0.01);
}

INSTANTIATE_TEST_SUITE_P(Fleets, MixedFleet,
                         ::testing::Values(std::set<int>{0}, std::set<int>{2},
                                           std::set<int>{1, 2}));

TEST(MixedFleetOfCameras, WithoutMetricSensorsClaimsNothing) {
  const SyntheticMission mission = MakeFleet({});
  const auto builder = std::move(MapBuilder::Create({})).value();
  IntegrateMission(mission, 0, 99, false, builder.get());
  builder->SettleCompletely();
  ASSERT_EQ(builder->snapshot()->components.size(), 1u);
  EXPECT_FALSE(builder->snapshot()->components[0].metric);
  EXPECT_FALSE(builder->snapshot()->components[0].georeference);
  EXPECT_GT(std::abs(ScaleError(mission, *builder->snapshot())), 0.1);
}

}  // namespace
}  // namespace portolan
