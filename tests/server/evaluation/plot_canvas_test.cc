#include "server/evaluation/plot_canvas.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace portolan {
namespace {

using testing::DoubleNear;
using testing::ElementsAre;
using testing::IsEmpty;

TEST(RoundTicks, AreMultiplesOfOneTwoOrFive) {
  EXPECT_THAT(RoundTicks({0, 10}, 5), ElementsAre(0, 2, 4, 6, 8, 10));
  EXPECT_THAT(RoundTicks({-1.2, 0.9}, 4), ElementsAre(-1, 0));
  EXPECT_THAT(RoundTicks({0.101, 0.149}, 5),
              ElementsAre(DoubleNear(0.11, 1e-12), DoubleNear(0.12, 1e-12), DoubleNear(0.13, 1e-12),
                          DoubleNear(0.14, 1e-12)));
  EXPECT_THAT(RoundTicks({3, 3}, 5), IsEmpty());
}

TEST(FormatTick, HasTheDigitsOfItsStep) {
  EXPECT_EQ(FormatTick(0.25, 0.05), "0.25");
  EXPECT_EQ(FormatTick(3, 1), "3");
  EXPECT_EQ(FormatTick(1500, 500), "1500");
  EXPECT_EQ(FormatTick(-0.5, 0.5), "-0.5");
}

TEST(PlotRange, PadsAndNeverVanishes) {
  PlotRange range = EmptyRange();
  EXPECT_GT(range.Padded(0.1).size(), 0);
  range.Include(2);
  EXPECT_GT(range.Padded(0.1).size(), 0);
  range.Include(4);
  EXPECT_DOUBLE_EQ(range.Padded(0.1).low, 1.8);
  EXPECT_DOUBLE_EQ(range.Padded(0.1).high, 4.2);
}

TEST(PlotPanel, EqualScaleKeepsShapes) {
  PlotCanvas canvas(800, 600);
  const PlotPanel panel({{0, 0, 800, 600}, "t", "x", "y", {0, 10}, {0, 1}, true}, &canvas);
  const Eigen::Vector2d origin = panel.ToPixel(0, 0);
  const Eigen::Vector2d one = panel.ToPixel(1, 1);
  EXPECT_NEAR(one.x() - origin.x(), origin.y() - one.y(), 1e-9);
  EXPECT_NEAR(panel.ToPixel(10, 0).x(), panel.frame().br().x, 1e-9);
}

TEST(PlotPanel, DrawsInsideItsFrameOnly) {
  PlotCanvas canvas(800, 600);
  const PlotColour red(0, 0, 255);
  PlotPanel panel({{0, 0, 800, 600}, "", "", "", {0, 1}, {0, 1}, false}, &canvas);
  const cv::Mat3b before = canvas.Finish();
  panel.DrawPoints({{1.5, 0.5}, {0.5, -0.2}}, red, 5);
  EXPECT_EQ(cv::norm(before, canvas.Finish(), cv::NORM_INF), 0);
  panel.DrawPoints({{0.5, 0.5}}, red, 5);
  const Eigen::Vector2d pixel = panel.ToPixel(0.5, 0.5);
  const cv::Mat3b after = canvas.Finish();
  EXPECT_EQ(after(static_cast<int>(pixel.y()), static_cast<int>(pixel.x())), cv::Vec3b(0, 0, 255));
}

TEST(ErrorColour, RunsFromDarkToBright) {
  EXPECT_EQ(ErrorColour(-1), ErrorColour(0));
  EXPECT_EQ(ErrorColour(2), ErrorColour(1));
  const auto lightness = [](const PlotColour& c) { return c[0] + c[1] + c[2]; };
  EXPECT_LT(lightness(ErrorColour(0)), lightness(ErrorColour(0.5)));
  EXPECT_LT(lightness(ErrorColour(0.5)), lightness(ErrorColour(1)));
}

}  // namespace
}  // namespace portolan
