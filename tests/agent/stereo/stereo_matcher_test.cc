#include "agent/stereo/stereo_matcher.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "tests/support/matchers.h"
#include "tests/synthetic/frame_renderer.h"

namespace portolan {
namespace {

using absl::StatusCode;
using testing::HasSubstr;

constexpr double kBaseline_m = 0.11;

// Two cameras side by side in the rendered hall, and the true depths of the first.
class StereoMatcherTest : public testing::Test {
 protected:
  StereoMatcherTest() : mission_(MakeMission()), camera_(MakeCamera(mission_)) {
    synthetic::FrameRenderer first(mission_, 0);
    first.Render(0, &first_);
    cv::Mat1f light;
    first.RenderLight(0, &light);
    depth_ = first.Depth().clone();
    const synthetic::Mission of_second = mission_.OfSecondCamera();
    synthetic::FrameRenderer(of_second, 0).Render(0, &second_);
    mount_ = {camera_, {Eigen::Quaterniond::Identity(), {-kBaseline_m, 0, 0}}};
  }

  static synthetic::Mission MakeMission() {
    synthetic::MissionOptions options;
    options.name = "loop";
    options.frames = 2;
    options.stereo_baseline_m = kBaseline_m;
    return *synthetic::MakeMission(options);
  }
  static CameraModel MakeCamera(const synthetic::Mission& mission) {
    return *CameraModel::Create(mission.options.camera);
  }

  double TrueInverseDistance(const Eigen::Vector2d& pixel) const {
    const double depth = depth_(static_cast<int>(pixel.y()), static_cast<int>(pixel.x()));
    const Eigen::Vector3d ray = *camera_.Unproject(pixel);
    return ray.z() / depth;
  }

  // Every 40th pixel with texture: measured depths, those beyond three sigma, mean square in
  // sigmas.
  struct Score {
    int measured = 0, wrong = 0;
    double mean_square = 0;
  };
  Score ScoreOf(StereoMatcher& matcher) const {
    Score score;
    double sum = 0;
    for (int y = 40; y < first_.rows - 40; y += 40) {
      for (int x = 40; x < first_.cols - 40; x += 40) {
        const auto depth = matcher.Measure(Eigen::Vector2d(x, y));
        if (!depth) continue;
        ++score.measured;
        const double sigmas = (depth->inverse_depth - TrueInverseDistance({x, y})) / depth->sigma;
        if (std::abs(sigmas) > 3) {
          ++score.wrong;
        } else {
          sum += sigmas * sigmas;
        }
      }
    }
    score.mean_square = sum / std::max(1, score.measured - score.wrong);
    return score;
  }

  const synthetic::Mission mission_;
  const CameraModel camera_;
  StereoMount mount_{camera_, {}};
  cv::Mat1b first_, second_;
  cv::Mat1f depth_;
};

TEST_F(StereoMatcherTest, MeasuresTheDepthsOfAHall) {
  StereoMatcher matcher({}, camera_, mount_);
  matcher.SetImages(first_, second_);
  const Score score = ScoreOf(matcher);
  EXPECT_GT(score.measured, 60);
  // The patch of a corner may straddle two depths.
  EXPECT_LE(score.wrong, score.measured / 12);
  EXPECT_GT(score.mean_square, 0.1);
  EXPECT_LT(score.mean_square, 1.5);
}

TEST_F(StereoMatcherTest, AWrongExtrinsicRotationFindsNothing) {
  // Epipolar curves off by 5 px: nearly nothing may be taken for a match.
  mount_.camera_from_first.rotation = RotationExp({0.01, 0, 0});
  StereoMatcher matcher({}, camera_, mount_);
  matcher.SetImages(first_, second_);
  EXPECT_LT(ScoreOf(matcher).measured, 10);
}

TEST_F(StereoMatcherTest, WithoutTheSceneThereIsNoDepth) {
  StereoMatcher matcher({}, camera_, mount_);
  cv::Mat1b noise(first_.size());
  cv::randu(noise, 0, 255);
  matcher.SetImages(first_, noise);
  EXPECT_EQ(ScoreOf(matcher).measured, 0);
  matcher.SetImages(first_, cv::Mat::zeros(first_.size(), CV_8UC1));
  EXPECT_EQ(ScoreOf(matcher).measured, 0);
  EXPECT_FALSE(matcher.Measure(Eigen::Vector2d(std::numeric_limits<double>::quiet_NaN(), 100)));
  EXPECT_FALSE(matcher.Measure(Eigen::Vector2d(-50, 1e9)));
}

TEST_F(StereoMatcherTest, NothingNearerThanTheNearest) {
  StereoOptions options;
  options.nearest_m = 1000;
  StereoMatcher matcher(options, camera_, mount_);
  matcher.SetImages(first_, second_);
  EXPECT_LE(ScoreOf(matcher).measured, 3);
}

TEST_F(StereoMatcherTest, MetricDepthsByTrack) {
  StereoMatcher matcher({}, camera_, mount_);
  matcher.SetImages(first_, second_);
  std::vector<Measurement> points;
  for (uint32_t i = 0; i < 12; ++i) points.push_back({TrackId(i + 1), {60.0 + 50 * i, 240}, 0.5});
  const auto depths = matcher.Measure(points);
  ASSERT_GT(depths.size(), 3u);
  for (const MeasuredDepth& depth : depths) {
    EXPECT_TRUE(depth.is_metric);
    const Eigen::Vector2d& pixel = points[depth.track.value() - 1].pixel;
    EXPECT_EQ(depth.inverse_depth, matcher.Measure(pixel)->inverse_depth);
  }
}

TEST(StereoOptions, AreChecked) {
  EXPECT_THAT(StereoOptions().Validate(), IsOk());
  StereoOptions options;
  options.nearest_m = 0;
  EXPECT_THAT(options.Validate(), StatusIs(StatusCode::kInvalidArgument, HasSubstr("nearest_m")));
  options = {};
  options.min_correlation = 1;
  EXPECT_THAT(options.Validate(), StatusIs(StatusCode::kInvalidArgument));
}

}  // namespace
}  // namespace portolan
