#include "agent/tracker/image_pyramid.h"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "tests/agent/tracker/test_images.h"

namespace portolan {
namespace {

TEST(ImagePyramid, PixelOfLevelIsHalfThePixelBelow) {
  const WaveTexture texture(3);
  ImagePyramid pyramid;
  // Only waves that survive the smoothing: seen at four times the size.
  pyramid.Build(Render(texture, {.affine = RotationScale(0, 4)}, 160, 120), 2);
  ASSERT_EQ(pyramid.num_levels(), 3);
  const PyramidLevel fine = pyramid.Level(0), coarse = pyramid.Level(1);
  for (int y = 5; y < 50; y += 5) {
    for (int x = 5; x < 70; x += 5) {
      EXPECT_NEAR(*coarse.At(x, y), *fine.At(2 * x, 2 * y), 6.0);
    }
  }
}

TEST(ImagePyramid, LevelsEqualThoseOfOpenCv) {
  for (const cv::Size size : {cv::Size(752, 480), cv::Size(67, 33), cv::Size(34, 129),
                              cv::Size(32, 32), cv::Size(161, 70)}) {
    cv::Mat image(size, CV_8UC1);
    cv::theRNG().state = 7;
    cv::randu(image, 0, 256);
    ImagePyramid pyramid;
    pyramid.Build(image, 1);
    cv::Mat expected;
    cv::pyrDown(image, expected);
    const PyramidLevel half = pyramid.Level(1);
    ASSERT_EQ(cv::Size(half.width_px, half.height_px), expected.size());
    const cv::Mat actual(expected.size(), CV_8UC1, const_cast<uint8_t*>(half.origin), half.stride);
    EXPECT_EQ(cv::norm(actual, expected, cv::NORM_INF), 0) << size;
  }
}

TEST(ImagePyramid, StopsBeforeLevelsGetTooSmall) {
  ImagePyramid pyramid;
  pyramid.Build(cv::Mat::zeros(41, 67, CV_8UC1), 6);
  ASSERT_EQ(pyramid.num_levels(), 2);
  EXPECT_EQ(pyramid.Level(1).width_px, 34);
  EXPECT_EQ(pyramid.Level(1).height_px, 21);
}

TEST(ImagePyramid, ContinuesTheEdgeAndKeepsTheImageApart) {
  cv::Mat image(60, 80, CV_8UC1, cv::Scalar(7));
  image.at<uint8_t>(0, 0) = 99;
  ImagePyramid pyramid;
  pyramid.Build(image, 0);
  image.setTo(0);
  const PyramidLevel level = pyramid.Level(0);
  EXPECT_EQ(*level.At(-kPyramidPaddingPx, -kPyramidPaddingPx), 99);
  EXPECT_EQ(*level.At(79 + kPyramidPaddingPx, 59 + kPyramidPaddingPx), 7);
  EXPECT_TRUE(level.Holds(-kPyramidPaddingPx, 0, 79 + kPyramidPaddingPx, 59));
  EXPECT_FALSE(level.Holds(-kPyramidPaddingPx - 1, 0, 10, 10));
  EXPECT_FALSE(level.Holds(0, 0, 10, 60 + kPyramidPaddingPx));
}

TEST(ImagePyramid, ReusedBuffersFollowTheNewImage) {
  ImagePyramid pyramid;
  pyramid.Build(cv::Mat(64, 64, CV_8UC1, cv::Scalar(200)), 2);
  pyramid.Build(cv::Mat(64, 64, CV_8UC1, cv::Scalar(10)), 2);
  EXPECT_EQ(*pyramid.Level(1).At(16, 16), 10);
  EXPECT_EQ(*pyramid.Level(0).At(-5, 70), 10);
}

}  // namespace
}  // namespace portolan
