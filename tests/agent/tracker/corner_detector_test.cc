#include "agent/tracker/corner_detector.h"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

#include "agent/tracker/detection_grid.h"
#include "agent/tracker/response_map.h"
#include "tests/agent/tracker/test_images.h"

namespace portolan {
namespace {

cv::Mat Square(double left, double top) {
  // Anti-aliased bright square of 40 px.
  cv::Mat image(120, 120, CV_8UC1, cv::Scalar(40));
  const int shift = 8;
  const auto fixed = [&](double v) { return cvRound(v * (1 << shift)); };
  cv::rectangle(image, cv::Point(fixed(left), fixed(top)),
                cv::Point(fixed(left + 40), fixed(top + 40)), cv::Scalar(200), cv::FILLED,
                cv::LINE_AA, shift);
  return image;
}

class EveryDetector : public testing::TestWithParam<DetectorType> {};

TEST_P(EveryDetector, FindsTheCornerOfASquareInItsCellOnly) {
  DetectorOptions options;
  options.type = GetParam();
  const auto detector = CornerDetector::Create(options);
  const cv::Mat image = Square(50, 50);
  const auto corners = detector->Detect(image, cv::Rect(38, 38, 24, 24));
  ASSERT_FALSE(corners.empty());
  EXPECT_LT((corners[0].pixel - Eigen::Vector2d(50, 50)).norm(), 5.0);
  EXPECT_TRUE(detector->Detect(image, cv::Rect(2, 2, 20, 20)).empty());
  for (size_t i = 1; i < corners.size(); ++i) {
    EXPECT_LE(corners[i].response, corners[i - 1].response);
  }
}

TEST_P(EveryDetector, FindsNothingInAFlatImage) {
  DetectorOptions options;
  options.type = GetParam();
  const cv::Mat flat(100, 100, CV_8UC1, cv::Scalar(128));
  EXPECT_TRUE(CornerDetector::Create(options)->Detect(flat, cv::Rect(0, 0, 100, 100)).empty());
}

INSTANTIATE_TEST_SUITE_P(All, EveryDetector,
                         testing::Values(DetectorType::kShiTomasi, DetectorType::kHarris,
                                         DetectorType::kFast, DetectorType::kOrb,
                                         DetectorType::kSift));

TEST(ResponseMap, AgreesWithItsDefinition) {
  const cv::Mat image = Render(WaveTexture(8), {}, 90, 70);
  const cv::Mat window = (cv::Mat_<float>(1, 7) << 1, 2, 3, 4, 3, 2, 1) / 16.0;
  cv::Mat dx, dy, xx, xy, yy;
  cv::Sobel(image, dx, CV_32F, 1, 0, 3, 1.0 / 8.0);
  cv::Sobel(image, dy, CV_32F, 0, 1, 3, 1.0 / 8.0);
  cv::sepFilter2D(dx.mul(dx), xx, CV_32F, window, window);
  cv::sepFilter2D(dx.mul(dy), xy, CV_32F, window, window);
  cv::sepFilter2D(dy.mul(dy), yy, CV_32F, window, window);
  const cv::Rect area(20, 15, 40, 30);
  const auto response = ComputeResponse(image, area, CornerMeasure::kSmallEigenvalue);
  for (int y = 0; y < area.height; ++y) {
    for (int x = 0; x < area.width; ++x) {
      const auto at = [&](const cv::Mat& m) { return m.at<float>(area.y + y, area.x + x); };
      const double trace = at(xx) + at(yy);
      const double expected = (at(xx) * at(yy) - at(xy) * at(xy)) / trace;
      ASSERT_NEAR(response[y * area.width + x], expected, 1e-3 * trace);
    }
  }
}

TEST(ResponseMap, WorksAtTheImagesEdgeAndInTinyImages) {
  const cv::Mat image = Render(WaveTexture(8), {}, 5, 4);
  const auto response =
      ComputeResponse(image, cv::Rect(0, 0, 5, 4), CornerMeasure::kSmallEigenvalue);
  ASSERT_EQ(response.size(), 20u);
  for (const float r : response) EXPECT_TRUE(std::isfinite(r));
}

TEST(CornerDetector, MovesWithTheImageBySubPixels) {
  const WaveTexture texture(21);
  const auto detector = CornerDetector::Create({});
  const View moved{.shift = {0.4, 0.3}};
  const auto before = detector->Detect(Render(texture, {}, 120, 120), cv::Rect(30, 30, 60, 60));
  const auto after = detector->Detect(Render(texture, moved, 120, 120), cv::Rect(20, 20, 80, 80));
  ASSERT_FALSE(before.empty());
  std::vector<double> errors;
  for (const Corner& a : before) {
    double nearest = 1e9;
    for (const Corner& b : after) {
      nearest = std::min(nearest, (b.pixel - moved.Map(a.pixel)).norm());
    }
    errors.push_back(nearest);
  }
  std::sort(errors.begin(), errors.end());
  EXPECT_LT(errors[errors.size() / 2], 0.25);
  EXPECT_LT(errors[errors.size() * 8 / 10], 0.6);
}

DetectionGrid MakeGrid(int width, int height, int corners) {
  return DetectionGrid({.width_px = width, .height_px = height, .target_corners = corners},
                       CornerDetector::Create({}));
}

TEST(DetectionGrid, SpreadsCornersOverTheImage) {
  const cv::Mat image = Render(WaveTexture(4), {}, 320, 240);
  DetectionGrid grid = MakeGrid(320, 240, 48);
  const auto corners = grid.FindCorners(image, {}, 100);
  EXPECT_GE(corners.size(), 40u);
  for (size_t i = 0; i < corners.size(); ++i) {
    EXPECT_GE(corners[i].pixel.minCoeff(), 10.0);
    for (size_t j = 0; j < i; ++j) {
      EXPECT_GE((corners[i].pixel - corners[j].pixel).norm(), 0.3 * 40.0);
    }
  }
}

TEST(DetectionGrid, LeavesOccupiedCellsAndTheNeighbourhoodOfTracksAlone) {
  const cv::Mat image = Render(WaveTexture(4), {}, 320, 240);
  const auto all = MakeGrid(320, 240, 48).FindCorners(image, {}, 100);
  std::vector<Eigen::Vector2d> taken;
  for (size_t i = 0; i + 3 < all.size(); ++i) taken.push_back(all[i].pixel);
  const auto more = MakeGrid(320, 240, 48).FindCorners(image, taken, 100);
  EXPECT_GE(more.size(), 2u);
  EXPECT_LE(more.size(), 8u);
}

TEST(DetectionGrid, KeepsTheStrongestWhenRoomIsShort) {
  const cv::Mat image = Render(WaveTexture(4), {}, 320, 240);
  const auto all = MakeGrid(320, 240, 48).FindCorners(image, {}, 100);
  const auto few = MakeGrid(320, 240, 48).FindCorners(image, {}, 5);
  ASSERT_EQ(few.size(), 5u);
  for (int i = 0; i < 5; ++i) EXPECT_EQ(few[i].pixel, all[i].pixel);
  EXPECT_TRUE(MakeGrid(320, 240, 48).FindCorners(image, {}, 0).empty());
}

TEST(DetectionGrid, ComesBackToBarrenCells) {
  DetectionGrid grid = MakeGrid(320, 240, 48);
  const cv::Mat blank(240, 320, CV_8UC1, cv::Scalar(9));
  const std::vector<Eigen::Vector2d> taken = {{11, 11}};
  EXPECT_TRUE(grid.FindCorners(blank, taken, 100).empty());
  const cv::Mat image = Render(WaveTexture(4), {}, 320, 240);
  int calls = 0;
  while (grid.FindCorners(image, taken, 100).empty() && calls < 20) ++calls;
  EXPECT_GT(calls, 0);
  EXPECT_LE(calls, 4);
}

TEST(DetectionGrid, AStartLooksEverywhere) {
  DetectionGrid grid = MakeGrid(320, 240, 48);
  EXPECT_TRUE(grid.FindCorners(cv::Mat(240, 320, CV_8UC1, cv::Scalar(9)), {}, 100).empty());
  EXPECT_FALSE(grid.FindCorners(Render(WaveTexture(4), {}, 320, 240), {}, 100).empty());
}

TEST(DetectorOptions, RejectsNonsense) {
  EXPECT_TRUE(DetectorOptions{}.Validate().ok());
  EXPECT_FALSE(DetectorOptions{.min_eigenvalue = -1.0}.Validate().ok());
  EXPECT_FALSE(DetectorOptions{.min_harris_response = std::nan("")}.Validate().ok());
  EXPECT_FALSE(DetectorOptions{.fast_threshold = 0}.Validate().ok());
  EXPECT_FALSE(DetectorOptions{.sift_contrast_threshold = 0.0}.Validate().ok());
}

}  // namespace
}  // namespace portolan
