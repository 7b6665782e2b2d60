#include "agent/tracker/patch_flow.h"

#include <gtest/gtest.h>

#include "tests/agent/tracker/test_images.h"

namespace portolan {
namespace {

struct Pair {
  ImagePyramid from, to;
};

Pair MakePair(const View& second) {
  const WaveTexture texture(11);
  Pair pair;
  pair.from.Build(Render(texture, {}, 200, 160), 3);
  pair.to.Build(Render(texture, second, 200, 160), 3);
  return pair;
}

std::optional<Eigen::Vector2d> Follow(const Pair& pair, const Eigen::Vector2d& from,
                                      const Eigen::Vector2d& start, int last_level = 0) {
  return TrackTranslation(pair.from, pair.to, from, {&start, 1}, last_level);
}

TEST(TrackTranslation, FindsSubPixelShifts) {
  const View moved{.shift = {2.3, -1.6}};
  const Pair pair = MakePair(moved);
  for (int x = 30; x < 170; x += 35) {
    const Eigen::Vector2d from(x + 0.25, 0.7 * x);
    const auto to = Follow(pair, from, from);
    ASSERT_TRUE(to.has_value());
    EXPECT_LT((*to - moved.Map(from)).norm(), 0.06) << from.transpose();
  }
}

TEST(TrackTranslation, FindsLargeShiftsThroughThePyramid) {
  const View moved{.shift = {13.0, 9.0}};
  const Pair pair = MakePair(moved);
  int found = 0, tried = 0;
  for (int x = 40; x < 160; x += 10, ++tried) {
    const Eigen::Vector2d from(x, 80);
    const auto to = Follow(pair, from, from);
    found += to && (*to - moved.Map(from)).norm() < 0.2;
  }
  EXPECT_GE(found, tried - 2);
}

TEST(TrackTranslation, DoesNotCareForBrightnessOffset) {
  const View moved{.shift = {1.5, 0.5}, .offset = 25.0};
  const Pair pair = MakePair(moved);
  const auto to = Follow(pair, {100, 80}, {100, 80});
  ASSERT_TRUE(to.has_value());
  EXPECT_LT((*to - Eigen::Vector2d(101.5, 80.5)).norm(), 0.08);
}

TEST(TrackTranslation, TakesTheBetterOfTwoStarts) {
  const View moved{.shift = {40.0, -30.0}};
  const Pair pair = MakePair(moved);
  const Eigen::Vector2d from(90, 90);
  const std::vector<Eigen::Vector2d> starts = {from, moved.Map(from) + Eigen::Vector2d(2, -1)};
  const auto to = TrackTranslation(pair.from, pair.to, from, starts, 0);
  ASSERT_TRUE(to.has_value());
  EXPECT_LT((*to - moved.Map(from)).norm(), 0.06);
}

TEST(TrackTranslation, HasNoAnswerWithoutTextureOrInsideOfNothing) {
  Pair flat;
  flat.from.Build(cv::Mat(100, 100, CV_8UC1, cv::Scalar(90)), 2);
  flat.to.Build(cv::Mat(100, 100, CV_8UC1, cv::Scalar(90)), 2);
  EXPECT_FALSE(Follow(flat, {50, 50}, {50, 50}).has_value());
  const Pair pair = MakePair({});
  EXPECT_FALSE(Follow(pair, {100, 80}, {1e9, 80}).has_value());
  EXPECT_FALSE(Follow(pair, {100, 80}, {std::nan(""), 80}).has_value());
  EXPECT_FALSE(TrackTranslation(ImagePyramid(), pair.to, {9, 9}, {}, 0).has_value());
}

}  // namespace
}  // namespace portolan
