#include "tests/synthetic/texture.h"

#include <opencv2/core.hpp>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace portolan::synthetic {
namespace {

TEST(Texture, SamplesTexelCentresExactly) {
  const cv::Mat1b texels = (cv::Mat1b(2, 2) << 10, 20, 30, 40);
  const Texture texture(texels, 0.5, /*repeated=*/false);
  EXPECT_FLOAT_EQ(texture.Sample(0.25f, 0.25f, 0.1f), 10);
  EXPECT_FLOAT_EQ(texture.Sample(0.75f, 0.25f, 0.1f), 20);
  EXPECT_FLOAT_EQ(texture.Sample(0.25f, 0.75f, 0.1f), 30);
  EXPECT_FLOAT_EQ(texture.Sample(0.5f, 0.5f, 0.1f), 25);
  EXPECT_FLOAT_EQ(texture.Sample(-3.0f, 0.25f, 0.1f), 10);
}

TEST(Texture, LargeFootprintsAverage) {
  const Texture board = MakeCheckerboard(16, 16, 0.01, 0.005);
  EXPECT_FLOAT_EQ(board.Sample(0.005f, 0.005f, 0.001f), 40);
  EXPECT_FLOAT_EQ(board.Sample(0.015f, 0.005f, 0.001f), 215);
  EXPECT_NEAR(board.Sample(0.08f, 0.08f, 0.04f), 127.5, 1.0);
}

TEST(Texture, RepeatedOnesRepeat) {
  TextureOptions options;
  options.repeated = true;
  const Texture texture = MakeTexture(options);
  const float period_m = 256 * 0.004f;
  ASSERT_EQ(texture.level(0).cols, 256);
  for (const float u : {0.1f, 0.5f, 0.9f}) {
    EXPECT_NEAR(texture.Sample(u, 0.3f, 0.004f), texture.Sample(u + period_m, 0.3f, 0.004f), 0.5);
    EXPECT_NEAR(texture.Sample(u, 0.3f, 0.004f), texture.Sample(u - period_m, 0.3f, 0.004f), 0.5);
  }
}

TEST(MakeTexture, IsDeterministicBySeed) {
  TextureOptions options;
  const Texture first = MakeTexture(options), second = MakeTexture(options);
  options.seed = 2;
  const Texture other = MakeTexture(options);
  EXPECT_EQ(cv::norm(first.level(0), second.level(0), cv::NORM_INF), 0);
  EXPECT_GT(cv::norm(first.level(0), other.level(0), cv::NORM_INF), 20);
}

TEST(MakeTexture, ContrastFollowsTheOptions) {
  TextureOptions options;
  options.shapes_per_m2 = 0;
  const auto deviation = [](const TextureOptions& texture) {
    cv::Scalar mean, sigma;
    cv::meanStdDev(MakeTexture(texture).level(0), mean, sigma);
    return sigma[0];
  };
  const double full = deviation(options);
  options.noise_contrast /= 4;
  EXPECT_GT(full, 15);
  EXPECT_NEAR(deviation(options), full / 4, 1.5);
}

}  // namespace
}  // namespace portolan::synthetic
