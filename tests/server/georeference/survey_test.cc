#include "server/georeference/survey.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace portolan {
namespace {

using ::testing::HasSubstr;

ControlPoint GridPoint(const std::string& id, const Eigen::Vector3d& grid_m) {
  ControlPoint point;
  point.id = id;
  point.grid_m = grid_m;
  point.observations.resize(2);
  for (ControlObservation& observation : point.observations) observation.agent = AgentId("red");
  return point;
}

TEST(Survey, ValidPointPassesAndEachFaultIsNamed) {
  const ControlPoint valid = GridPoint("P12", {1, 2, 3});
  EXPECT_TRUE(ValidateControlPoint(valid).ok());
  const auto message_of = [&](const std::function<void(ControlPoint*)>& spoil) {
    ControlPoint point = valid;
    spoil(&point);
    return std::string(ValidateControlPoint(point).message());
  };
  EXPECT_THAT(message_of([](auto* p) { p->id = "a b"; }), HasSubstr("id"));
  EXPECT_THAT(message_of([](auto* p) { p->observations.pop_back(); }),
              HasSubstr("P12: needs at least 2"));
  EXPECT_THAT(message_of([](auto* p) { p->geodetic = GeodeticPosition(); }),
              HasSubstr("one position"));
  EXPECT_THAT(message_of([](auto* p) { p->grid_m.reset(); }), HasSubstr("one position"));
  EXPECT_THAT(message_of([](auto* p) { p->sigma_m = 0; }), HasSubstr("sigma"));
  EXPECT_THAT(message_of([](auto* p) { p->observations[1].pixel.x() = NAN; }), HasSubstr("pixel"));
  EXPECT_THAT(message_of([](auto* p) { p->observations[1].sigma_px = -1; }), HasSubstr("sigma"));
  EXPECT_THAT(message_of([](auto* p) {
                p->grid_m.reset();
                p->geodetic = GeodeticPosition{91, 0, 0};
              }),
              HasSubstr("latitude"));
}

TEST(Survey, GridIsShiftedAndTiedToTheEarthByTheOrigin) {
  const SiteOrigin origin{GeodeticPosition{47, 8, 400}, {2600000, 1200000, 400}};
  const auto grid = PositionInSite(origin, GridPoint("a", {2600010, 1200020, 395}));
  ASSERT_TRUE(grid.ok());
  EXPECT_EQ(*grid, Eigen::Vector3d(10, 20, -5));
  const auto geodetic = PositionInSite(origin, GeodeticPosition{47, 8, 401});
  ASSERT_TRUE(geodetic.ok());
  EXPECT_NEAR((*geodetic - Eigen::Vector3d(0, 0, 1)).norm(), 0, 1e-6);
}

TEST(Survey, WhatHasNoPlaceInTheSiteIsRefused) {
  EXPECT_THAT(std::string(PositionInSite(SiteOrigin{}, GeodeticPosition{}).status().message()),
              HasSubstr("set the origin"));
  EXPECT_THAT(
      std::string(
          PositionInSite(SiteOrigin{}, GridPoint("a", {2600010, 1200020, 395})).status().message()),
      HasSubstr("set an origin near"));
}

TEST(Survey, OriginIsTheOperatorsThenTheGridsThenTheFirstGeodeticPoint) {
  Survey survey;
  EXPECT_FALSE(ImpliedOrigin(survey));
  ControlPoint geodetic = GridPoint("a", {0, 0, 0});
  geodetic.grid_m.reset();
  geodetic.geodetic = GeodeticPosition{1, 2, 3};
  survey.points = {geodetic};
  EXPECT_EQ(ImpliedOrigin(survey)->geodetic, geodetic.geodetic);
  survey.points.push_back(GridPoint("b", {0, 0, 0}));
  EXPECT_FALSE(ImpliedOrigin(survey)->geodetic);
  survey.origin = SiteOrigin{GeodeticPosition{4, 5, 6}, {7, 8, 9}};
  EXPECT_EQ(ImpliedOrigin(survey), survey.origin);
}

}  // namespace
}  // namespace portolan
