// Known positions in a map of drifting submaps: satellite fixes, control points, and what they do
// to the error of the whole, without any alignment.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <set>

#include "server/map_builder.h"
#include "tests/support/replay_fleet.h"
#include "tests/support/synthetic_map.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;

const GeodeticPosition kOrigin{47.4, 8.5, 400};

// One vehicle on its way through a town, without loops. The truth is turned against the site.
class TownMission {
 public:
  explicit TownMission(int submaps) : fleet_(Drifting()) {
    for (int i = 0; i < submaps; ++i) {
      submaps_.push_back(fleet_.Next());
      for (Rigid3& pose : submaps_.back().world_from_camera) pose = site_from_truth_ * pose;
    }
  }

  // At every keyframe, of an antenna beside the camera.
  void AddFixes(double sigma_m, double wrong_share) {
    const LocalFrame frame(kOrigin);
    const Eigen::Vector3d antenna(0.3, -0.5, 0.1);
    for (ReplaySubmap& submap : submaps_) {
      Submap raw = *submap.submap;
      raw.antenna_in_camera_m = antenna;
      for (size_t k = 0; k + 1 < raw.keyframes.size(); ++k) {
        Eigen::Vector3d position = submap.world_from_camera[k] * antenna;
        for (double& x : position) x += sigma_m * normal_(random_);
        if (uniform_(random_) < wrong_share) position.x() += 40;
        raw.gnss.push_back({raw.keyframes[k].time, frame.ToGeodetic(position), sigma_m, sigma_m});
      }
      submap.submap = std::make_shared<const Submap>(std::move(raw));
    }
  }

  // 8 m ahead of the middle of every nth submap, as its images show it.
  Survey MakeSurvey(int every) {
    Survey survey;
    survey.origin = SiteOrigin{kOrigin, Eigen::Vector3d::Zero()};
    for (size_t i = 0; i < submaps_.size(); i += every) {
      const ReplaySubmap& submap = submaps_[i];
      ControlPoint point;
      point.id = "P" + std::to_string(100 + i);
      point.grid_m = submap.world_from_camera[4] * Eigen::Vector3d(1, 0.5, 8);
      for (size_t k = 0; k < 10; k += 3) {
        const auto pixel =
            fleet_.camera()->Project(submap.world_from_camera[k].Inverse() * *point.grid_m);
        if (!pixel || !fleet_.camera()->IsInImage(*pixel, 0)) continue;
        point.observations.push_back(
            {submap.submap->key.agent, std::nullopt, submap.submap->keyframes[k].time,
             *pixel + Eigen::Vector2d(0.5 * normal_(random_), 0.5 * normal_(random_)), 0.5});
      }
      if (point.observations.size() >= 2) survey.points.push_back(std::move(point));
    }
    return survey;
  }

  std::unique_ptr<MapBuilder> Build(const Survey& survey, int full_component_submaps = 80,
                                    const RedundancyOptions& redundancy = {}) const {
    MapBuilderOptions options;
    options.redundancy = redundancy;
    options.aligner.full_component_submaps = full_component_submaps;
    options.aligner.settled_component_submaps = full_component_submaps;
    options.max_candidates = 0;
    options.aligner.positions.fix_correlation = Duration::zero();
    auto builder = std::move(MapBuilder::Create(options)).value();
    builder->SetSurvey(std::make_shared<const Survey>(survey));
    for (size_t i = 0; i < submaps_.size(); ++i) {
      builder->IntegrateSubmap(
          {SubmapId(static_cast<int64_t>(i) + 1), submaps_[i].submap, fleet_.camera()});
    }
    builder->SettleCompletely();
    return builder;
  }

  // Of all keyframes: in the site as they are, or after the best similarity.
  double Rms(const MapSnapshot& snapshot, bool aligned) const {
    std::vector<Eigen::Vector3d> estimate, truth;
    double sum = 0;
    for (size_t i = 0; i < submaps_.size(); ++i) {
      for (size_t k = 0; k < submaps_[i].world_from_camera.size(); ++k) {
        estimate.push_back(snapshot.submaps[i]->world_from_camera[k].translation);
        truth.push_back(submaps_[i].world_from_camera[k].translation);
        sum += (estimate.back() - truth.back()).squaredNorm();
      }
    }
    return aligned ? AlignedRms(estimate, truth)
                   : std::sqrt(sum / static_cast<double>(truth.size()));
  }

 private:
  static ReplayFleetOptions Drifting() {
    ReplayFleetOptions options = ReplayFleetOptions::For(40, 1, 1, 5);
    options.keyframe_distance_m = 1.2;
    options.max_tracks = 40;
    options.pixel_sigma = 1.5;
    return options;
  }
  static Rigid3 SiteFromTruth() {
    return {Eigen::Quaterniond(Eigen::AngleAxisd(0.6, Eigen::Vector3d::UnitZ())), {30, -20, 5}};
  }

  const Rigid3 site_from_truth_ = SiteFromTruth();
  ReplayFleet fleet_;
  std::vector<ReplaySubmap> submaps_;
  std::mt19937 random_{7};
  std::normal_distribution<double> normal_{0, 1};
  std::uniform_real_distribution<double> uniform_{0, 1};
};

Survey OriginOnly() {
  Survey survey;
  survey.origin = SiteOrigin{kOrigin, Eigen::Vector3d::Zero()};
  return survey;
}

TEST(GeoreferencedMap, FixesTakeTheDriftOut) {
  TownMission mission(20);
  const double drift = mission.Rms(*mission.Build({})->snapshot(), true);
  mission.AddFixes(1.0, 0);
  const auto snapshot = mission.Build(OriginOnly())->snapshot();
  ASSERT_EQ(snapshot->components.size(), 1u);
  const auto& report = snapshot->components[0].georeference;
  ASSERT_TRUE(report);
  EXPECT_TRUE(report->is_georeferenced) << report->problem;
  const double rms = mission.Rms(*snapshot, false);
  std::printf("rms of the keyframes: %.3f m aligned without fixes, %.3f m in the site with\n",
              drift, rms);
  std::printf("residuals %.3f %.3f\n", report->rms_fix_horizontal_m, report->rms_fix_vertical_m);
  EXPECT_LT(rms, 0.5 * drift);
  EXPECT_LT(rms, 0.5);
  EXPECT_NEAR(report->rms_fix_horizontal_m, std::sqrt(2.0), 0.2);
  EXPECT_NEAR(report->rms_fix_vertical_m, 1.0, 0.2);
  EXPECT_EQ(report->fix_count, 300);
  EXPECT_TRUE(snapshot->components[0].metric);
}

// By relaxations and regions alone.
TEST(GeoreferencedMap, FixesTakeTheDriftOutOfALargeComponent) {
  TownMission mission(20);
  mission.AddFixes(1.0, 0);
  const auto snapshot = mission.Build(OriginOnly(), 6)->snapshot();
  ASSERT_EQ(snapshot->components.size(), 1u);
  const auto& report = snapshot->components[0].georeference;
  ASSERT_TRUE(report && report->is_georeferenced);
  const double rms = mission.Rms(*snapshot, false);
  std::printf("rms of the keyframes of a large component: %.3f m\n", rms);
  EXPECT_LT(rms, 0.5);
}

TEST(GeoreferencedMap, WrongFixesLoseTheirSay) {
  TownMission mission(10);
  mission.AddFixes(0.5, 0.1);
  const auto snapshot = mission.Build(OriginOnly())->snapshot();
  const auto& report = snapshot->components[0].georeference;
  ASSERT_TRUE(report && report->is_georeferenced);
  EXPECT_GT(report->outlier_count, 5);
  EXPECT_LT(mission.Rms(*snapshot, false), 0.5);
}

TEST(GeoreferencedMap, FiveControlPointsTakeTheDriftOut) {
  TownMission mission(20);
  const double drift = mission.Rms(*mission.Build({})->snapshot(), true);
  const Survey survey = mission.MakeSurvey(4);
  ASSERT_EQ(survey.points.size(), 5u);
  const auto snapshot = mission.Build(survey)->snapshot();
  const auto& report = snapshot->components[0].georeference;
  ASSERT_TRUE(report);
  EXPECT_TRUE(report->is_georeferenced) << report->problem;
  EXPECT_EQ(report->control_point_count, 5);
  const double rms = mission.Rms(*snapshot, false);
  std::printf("rms of the keyframes: %.3f m aligned without, %.3f m in the site with 5 points\n",
              drift, rms);
  std::printf("residuals %.3f %.3f\n", report->rms_control_horizontal_m,
              report->rms_control_vertical_m);
  EXPECT_LT(rms, 0.5 * drift);
  EXPECT_LT(report->rms_control_horizontal_m, 0.1);
}

// The keyframes of this town see so little that none is redundant, unless one insists.
TEST(GeoreferencedMap, RedundantKeyframesSeeControlPointsToo) {
  TownMission mission(20);
  const Survey survey = mission.MakeSurvey(4);
  RedundancyOptions redundancy;
  redundancy.whole_submaps = 0;
  redundancy.min_tracks_of_keyframe = 10;
  const auto snapshot = mission.Build(survey, 80, redundancy)->snapshot();
  std::set<Timestamp> redundant;
  for (const auto& state : snapshot->submaps) {
    for (const int k : state->refined->redundant_keyframes) {
      redundant.insert(state->refined->raw->keyframes[k].time);
    }
  }
  int by_redundant = 0;
  for (const ControlPoint& point : survey.points) {
    for (const ControlObservation& seen : point.observations) {
      by_redundant += redundant.contains(seen.time) ? 1 : 0;
    }
  }
  EXPECT_GE(by_redundant, 5);
  const auto& report = snapshot->components[0].georeference;
  ASSERT_TRUE(report);
  EXPECT_TRUE(report->is_georeferenced) << report->problem;
  // Taken for the neighbours' own, their pixels leave 0.08 m, and the map 2 m.
  EXPECT_LT(report->rms_control_horizontal_m, 0.03);
  EXPECT_LT(mission.Rms(*snapshot, false), 1.0);
}

TEST(GeoreferencedMap, PointsThatAreTakenAwayAgainLeaveNoClaim) {
  TownMission mission(6);
  Survey survey = mission.MakeSurvey(1);
  const auto builder = mission.Build(survey);
  ASSERT_TRUE(builder->snapshot()->components[0].georeference);
  ASSERT_TRUE(builder->snapshot()->components[0].georeference->is_georeferenced)
      << builder->snapshot()->components[0].georeference->problem;
  survey.points.resize(2);
  builder->SetSurvey(std::make_shared<const Survey>(survey));
  builder->SettleCompletely();
  const ComponentState component = builder->snapshot()->components[0];
  ASSERT_TRUE(component.georeference);
  EXPECT_FALSE(component.georeference->is_georeferenced);
  EXPECT_THAT(component.georeference->problem, HasSubstr("at least 3"));
  EXPECT_FALSE(component.metric);
}

TEST(GeoreferencedMap, ContinuesFromASnapshot) {
  TownMission mission(8);
  mission.AddFixes(0.5, 0);
  const auto first = mission.Build(OriginOnly());
  const auto again = std::move(MapBuilder::Create({})).value();
  again->Restore(first->snapshot());
  again->SetSurvey(std::make_shared<const Survey>(OriginOnly()));
  again->SettleCompletely();
  const auto& report = again->snapshot()->components[0].georeference;
  ASSERT_TRUE(report && report->is_georeferenced);
  EXPECT_EQ(report->fix_count, 120);
  EXPECT_NEAR(mission.Rms(*again->snapshot(), false), mission.Rms(*first->snapshot(), false), 0.3);
}

}  // namespace
}  // namespace portolan
