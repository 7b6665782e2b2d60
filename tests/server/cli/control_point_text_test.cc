#include "server/cli/control_point_text.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <sstream>

namespace portolan {
namespace {

using ::testing::HasSubstr;

TEST(ControlPointText, TimesAreExact) {
  EXPECT_EQ(*ParseTimeNs("1403636579.763555584"), 1403636579763555584);
  EXPECT_EQ(*ParseTimeNs("100"), 100000000000);
  EXPECT_EQ(*ParseTimeNs("0.5"), 500000000);
  EXPECT_EQ(*ParseTimeNs("1403636579763555584ns"), 1403636579763555584);
  for (const char* text :
       {"", "ns", "-1", "1.5ns", "1e9", "1.0000000001", "1.2.3", "abc", "99999999999999999999"}) {
    EXPECT_FALSE(ParseTimeNs(text).ok()) << text;
  }
}

TEST(ControlPointText, Observations) {
  const auto plain = ParseObservation("red:1.5:320.25:240");
  ASSERT_TRUE(plain.ok()) << plain.status();
  EXPECT_EQ(plain->agent_id(), "red");
  EXPECT_EQ(plain->session_id(), 0u);
  EXPECT_EQ(plain->time_ns(), 1500000000);
  EXPECT_EQ(plain->u_px(), 320.25);
  EXPECT_EQ(plain->v_px(), 240);
  const auto full = ParseObservation("red/00000000000000fe:1.5:-3:240:0.5");
  ASSERT_TRUE(full.ok()) << full.status();
  EXPECT_EQ(full->session_id(), 0xfeu);
  EXPECT_EQ(full->sigma_px(), 0.5);
  for (const char* text : {"", "red", "red:1:2", "red:1:2:3:4:5", "red:x:2:3", "red:1:nan:3",
                           "red/xy:1:2:3", "red/:1:2:3", "red:1:2:3:0"}) {
    EXPECT_FALSE(ParseObservation(text).ok()) << text;
  }
}

TEST(ControlPointText, FileOfPoints) {
  std::stringstream file(
      "# a comment\n\nP1, wgs84, 47.1, 8.5, 400, 0.02, red:1:2:3 red:2:3:4  # and one here\n"
      "P2,grid,10,20,30,0.05,red:1:2:3 blue:2:3:4 blue:3:4:5\n");
  const auto points = ParseControlPoints(file);
  ASSERT_TRUE(points.ok()) << points.status();
  ASSERT_EQ(points->size(), 2u);
  EXPECT_EQ((*points)[0].geodetic().longitude_deg(), 8.5);
  EXPECT_EQ((*points)[0].observations_size(), 2);
  EXPECT_EQ((*points)[1].grid().z(), 30);
  EXPECT_EQ((*points)[1].observations_size(), 3);
}

TEST(ControlPointText, BadLineIsNamed) {
  const auto error_of = [](const std::string& text) {
    std::stringstream file("# first\n" + text);
    return std::string(ParseControlPoints(file).status().message());
  };
  EXPECT_THAT(error_of("P1,wgs84,1,2,3,0.1\n"), HasSubstr("line 2: expected 7 columns"));
  EXPECT_THAT(error_of("P1,utm,1,2,3,0.1,red:1:2:3\n"), HasSubstr("line 2: the system"));
  EXPECT_THAT(error_of("P1,grid,1,two,3,0.1,red:1:2:3\n"), HasSubstr("line 2: coordinate"));
  EXPECT_THAT(error_of("P1,grid,1,2,3,0.1,red\n"), HasSubstr("line 2: observation 'red'"));
}

}  // namespace
}  // namespace portolan
