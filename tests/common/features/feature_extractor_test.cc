#include "common/features/feature_extractor.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "common/features/rotated_brief.h"

namespace portolan {
namespace {

// Smooth noise: uniform random values, blurred and stretched.
cv::Mat NoiseImage(int width, int height, int seed) {
  cv::Mat noise(height, width, CV_8UC1);
  cv::RNG rng(seed);
  rng.fill(noise, cv::RNG::UNIFORM, 0, 256);
  cv::GaussianBlur(noise, noise, cv::Size(), 2.5);
  cv::normalize(noise, noise, 0, 255, cv::NORM_MINMAX);
  return noise;
}

std::vector<Eigen::Vector2d> GridPoints(int width, int height) {
  std::vector<Eigen::Vector2d> points;
  for (int y = 50; y < height - 50; y += 20) {
    for (int x = 50; x < width - 50; x += 20) points.emplace_back(x, y);
  }
  return points;
}

std::vector<DescribedPoint> Extract(const cv::Mat& image,
                                    const std::vector<Eigen::Vector2d>& points,
                                    const FeatureExtractorOptions& options) {
  auto described = ExtractFeatures(image, points, options);
  EXPECT_TRUE(described.ok()) << described.status();
  return described.ok() ? *described : std::vector<DescribedPoint>();
}

// Share of points whose nearest descriptor in the other image is their own.
double MatchShare(const std::vector<DescribedPoint>& a, const std::vector<DescribedPoint>& b) {
  int right = 0;
  for (const DescribedPoint& p : a) {
    const auto best = std::min_element(b.begin(), b.end(), [&](const auto& x, const auto& y) {
      return HammingDistance(p.descriptor, x.descriptor) <
             HammingDistance(p.descriptor, y.descriptor);
    });
    right += best->point_index == p.point_index;
  }
  return static_cast<double>(right) / a.size();
}

struct Warped {
  cv::Mat image;
  std::vector<Eigen::Vector2d> points;
};

Warped RotateAndScale(const cv::Mat& image, const std::vector<Eigen::Vector2d>& points,
                      double degrees, double scale) {
  const cv::Mat m =
      cv::getRotationMatrix2D(cv::Point2f(image.cols / 2, image.rows / 2), degrees, scale);
  Warped warped;
  cv::warpAffine(image, warped.image, m, image.size(), cv::INTER_LINEAR, cv::BORDER_REFLECT);
  for (const Eigen::Vector2d& p : points) {
    warped.points.emplace_back(
        m.at<double>(0, 0) * p.x() + m.at<double>(0, 1) * p.y() + m.at<double>(0, 2),
        m.at<double>(1, 0) * p.x() + m.at<double>(1, 1) * p.y() + m.at<double>(1, 2));
  }
  return warped;
}

TEST(ExtractFeatures, DescriptorsMatchUnderRotation) {
  const cv::Mat image = NoiseImage(320, 240, 1);
  const auto points = GridPoints(320, 240);
  const FeatureExtractorOptions options{.half_octaves = 1, .max_extra_corners = 0};
  const auto original = Extract(image, points, options);
  for (const double degrees : {17.0, 90.0, 143.0}) {
    const Warped turned = RotateAndScale(image, points, degrees, 1.0);
    EXPECT_GT(MatchShare(Extract(turned.image, turned.points, options), original), 0.85) << degrees;
  }
}

TEST(ExtractFeatures, HalfOctavesMatchAcrossScales) {
  const cv::Mat image = NoiseImage(480, 400, 2);
  const auto points = GridPoints(480, 400);
  const FeatureExtractorOptions one{.half_octaves = 1, .max_extra_corners = 0};
  const FeatureExtractorOptions three{.half_octaves = 3, .max_extra_corners = 0};
  const Warped half = RotateAndScale(image, points, 0.0, 0.5);
  const auto small = Extract(half.image, half.points, one);
  const double with_one = MatchShare(small, Extract(image, points, one));
  const double with_three = MatchShare(small, Extract(image, points, three));
  EXPECT_GT(with_three, 0.75);
  EXPECT_GT(with_three, with_one + 0.2);
}

TEST(ExtractFeatures, IsBlindToBrightness) {
  const cv::Mat image = NoiseImage(320, 240, 3);
  cv::Mat darker;
  image.convertTo(darker, CV_8U, 0.5, 20.0);
  const auto points = GridPoints(320, 240);
  const FeatureExtractorOptions options{.half_octaves = 1, .max_extra_corners = 0};
  EXPECT_GT(MatchShare(Extract(darker, points, options), Extract(image, points, options)), 0.95);
}

TEST(ExtractFeatures, AddsSpreadCornersAwayFromThePoints) {
  const cv::Mat image = NoiseImage(320, 240, 4);
  const auto points = GridPoints(320, 240);
  FeatureExtractorOptions options;
  options.half_octaves = 1;
  options.max_extra_corners = 60;
  const auto described = Extract(image, points, options);
  int extra = 0;
  for (const DescribedPoint& p : described) {
    if (p.point_index >= 0) continue;
    ++extra;
    const double scale = std::pow(2.0, 0.5 * p.half_octave);
    for (const Eigen::Vector2d& q : points) {
      EXPECT_GT((p.pixel - q).norm(), (options.min_distance_px - 2.0) * scale);
    }
  }
  EXPECT_GT(extra, 20);
  EXPECT_LE(extra, 60);
}

TEST(ExtractFeatures, LeavesOutPointsNearTheEdgeAndNonsense) {
  const cv::Mat image = NoiseImage(100, 80, 5);
  const FeatureExtractorOptions options{.half_octaves = 2, .max_extra_corners = 0};
  const auto described =
      Extract(image, {{50, 40}, {3, 40}, {50, 79}, {-1e9, 1e9}, {std::nan(""), 5}}, options);
  ASSERT_EQ(described.size(), 2u);
  for (const DescribedPoint& p : described) {
    EXPECT_EQ(p.point_index, 0);
    EXPECT_LT((p.pixel - Eigen::Vector2d(50, 40)).norm(), 1e-9);
  }
  EXPECT_TRUE(Extract(NoiseImage(20, 20, 6), {{10, 10}}, options).empty());
}

TEST(ExtractFeatures, IsRepeatable) {
  const cv::Mat image = NoiseImage(200, 150, 7);
  const auto a = Extract(image, {{80, 70}}, {}), b = Extract(image, {{80, 70}}, {});
  ASSERT_EQ(a.size(), b.size());
  for (size_t i = 0; i < a.size(); ++i) EXPECT_EQ(a[i].descriptor, b[i].descriptor);
}

TEST(ExtractFeatures, RefusesWrongImagesAndOptions) {
  EXPECT_FALSE(ExtractFeatures(cv::Mat(), {}, {}).ok());
  EXPECT_FALSE(ExtractFeatures(cv::Mat(90, 90, CV_8UC3), {}, {}).ok());
  const cv::Mat image = NoiseImage(90, 90, 8);
  EXPECT_FALSE(ExtractFeatures(image, {}, {.half_octaves = 9}).ok());
  EXPECT_FALSE(ExtractFeatures(image, {}, {.max_extra_corners = -1}).ok());
  EXPECT_FALSE(ExtractFeatures(image, {}, {.corner_half_octaves = 0}).ok());
  EXPECT_FALSE(ExtractFeatures(image, {}, {.fast_threshold = 300}).ok());
  EXPECT_FALSE(ExtractFeatures(image, {}, {.min_distance_px = std::nan("")}).ok());
}

TEST(RotatedBrief, AngleTurnsWithTheImage) {
  const cv::Mat image = NoiseImage(121, 121, 9);
  cv::Mat turned;
  cv::rotate(image, turned, cv::ROTATE_90_CLOCKWISE);
  const float before = IntensityCentroidAngle(image, {60, 60});
  const float after = IntensityCentroidAngle(turned, {60, 60});
  EXPECT_NEAR(std::remainder(after - before - M_PI / 2, 2 * M_PI), 0.0, 1e-4);
}

TEST(RotatedBrief, BitsOfRandomTextureAreBalanced) {
  const cv::Mat image = NoiseImage(640, 480, 10);
  std::array<int, 256> ones{};
  const auto points = GridPoints(640, 480);
  for (const Eigen::Vector2d& p : points) {
    const Descriptor d = DescribeRotatedBrief(image, p, IntensityCentroidAngle(image, p));
    for (int bit = 0; bit < 256; ++bit) ones[bit] += d.words[bit / 64] >> (bit % 64) & 1;
  }
  double worst = 0.0;
  for (const int count : ones) {
    worst = std::max(worst, std::abs(static_cast<double>(count) / points.size() - 0.5));
  }
  EXPECT_LT(worst, 0.45);
}

}  // namespace
}  // namespace portolan
