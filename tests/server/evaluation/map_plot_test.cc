#include "server/evaluation/map_plot.h"

#include <cmath>
#include <opencv2/imgcodecs.hpp>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "server/evaluation/plot_canvas.h"
#include "tests/support/matchers.h"
#include "tests/support/temp_dir.h"

namespace portolan {
namespace {

MapPlot CirclePlot() {
  MapPlot plot;
  plot.title = "circle";
  PlotTrajectory trajectory{"a", {}, {}, {}};
  for (int i = 0; i <= 100; ++i) {
    trajectory.positions.emplace_back(std::cos(0.06 * i), std::sin(0.06 * i), 0.1 * std::sin(i));
  }
  plot.trajectories.push_back(trajectory);
  return plot;
}

int CountColour(const cv::Mat3b& image, const PlotColour& colour) {
  cv::Mat mask;
  cv::inRange(image, colour - PlotColour::all(3), colour + PlotColour::all(3), mask);
  return cv::countNonZero(mask);
}

TEST(DrawMapPlot, DrawsTrajectoriesInTheAgentsColours) {
  MapPlot plot = CirclePlot();
  const cv::Mat3b one = DrawMapPlot(plot);
  EXPECT_EQ(one.size(), cv::Size(1600, 900));
  EXPECT_GT(CountColour(one, AgentColour(0)), 1000);
  EXPECT_EQ(CountColour(one, AgentColour(1)), 0);
  plot.trajectories.push_back(plot.trajectories[0]);
  for (Eigen::Vector3d& p : plot.trajectories[1].positions) p *= 0.5;
  EXPECT_GT(CountColour(DrawMapPlot(plot), AgentColour(1)), 500);
}

TEST(DrawMapPlot, ColoursErrorsWhereTheyAreKnown) {
  MapPlot plot = CirclePlot();
  PlotTrajectory& trajectory = plot.trajectories[0];
  for (size_t i = 0; i < trajectory.positions.size(); ++i) {
    trajectory.times_s.push_back(0.05 * static_cast<double>(i));
    trajectory.errors.push_back(i < 50 ? 0.0 : 1.0);
  }
  const cv::Mat3b image = DrawMapPlot(plot);
  const cv::Mat3b above = image(cv::Rect(0, 0, 960, 900));
  EXPECT_GT(CountColour(above, ErrorColour(0)), 300);
  EXPECT_GT(CountColour(above, ErrorColour(1)), 300);
}

TEST(DrawMapPlot, FarLandmarksDoNotShrinkThePaths) {
  MapPlot plot = CirclePlot();
  for (int i = 0; i < 1000; ++i) plot.landmarks.emplace_back(std::cos(i), std::sin(i), 0.0);
  const int near_only = CountColour(DrawMapPlot(plot), AgentColour(0));
  for (int i = 0; i < 10; ++i) plot.landmarks.emplace_back(1000.0 * i, 0, 0);
  EXPECT_NEAR(CountColour(DrawMapPlot(plot), AgentColour(0)), near_only, 0.1 * near_only);
}

TEST(DrawMapPlot, ManagesWithLittle) {
  EXPECT_FALSE(DrawMapPlot(MapPlot()).empty());
  MapPlot point;
  point.trajectories.push_back({"p", {{1, 2, 3}}, {0}, {0}});
  EXPECT_FALSE(DrawMapPlot(point).empty());
  MapPlot landmark;
  landmark.landmarks = {{1, 2, 3}};
  EXPECT_FALSE(DrawMapPlot(landmark).empty());
}

TEST(WriteMapPlot, WritesAPng) {
  const TempDir dir;
  const std::string path = (dir / "map.png").string();
  ASSERT_THAT(WriteMapPlot(CirclePlot(), path), IsOk());
  EXPECT_EQ(cv::norm(cv::imread(path), DrawMapPlot(CirclePlot()), cv::NORM_INF), 0);
}

TEST(WriteMapPlot, RejectsBadInput) {
  MapPlot plot = CirclePlot();
  EXPECT_FALSE(WriteMapPlot(plot, "no/such/folder/map.png").ok());
  EXPECT_FALSE(WriteMapPlot(plot, "map.unknown").ok());
  plot.trajectories[0].errors = {1, 2};
  EXPECT_THAT(WriteMapPlot(plot, "map.png"), StatusIs(absl::StatusCode::kInvalidArgument));
  plot = CirclePlot();
  plot.width_px = 10;
  EXPECT_THAT(WriteMapPlot(plot, "map.png"), StatusIs(absl::StatusCode::kInvalidArgument));
}

}  // namespace
}  // namespace portolan
