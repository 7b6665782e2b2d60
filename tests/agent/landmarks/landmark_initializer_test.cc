#include "agent/landmarks/landmark_initializer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <map>
#include <random>

#include "tests/agent/filter/point_world.h"
#include "tests/support/matchers.h"

namespace portolan {
namespace {

constexpr int kPoints = 60;

// A camera that moves sideways past fixed points, its poses known.
class Passage {
 public:
  explicit Passage(double noise_px = 0.3) : noise_(0, noise_px) {
    std::uniform_real_distribution<double> uniform(-1, 1);
    for (int i = 0; i < kPoints; ++i) {
      const double x = 2.0 * uniform(random_), y = uniform(random_);
      points_.emplace_back(x, y, 4 + uniform(random_));
    }
  }
  Rigid3 PoseAt(int frame) const {
    return {RotationExp({0, 0.002 * frame, 0}), Eigen::Vector3d(0.02 * frame, 0, 0.005 * frame)};
  }
  std::vector<TrackedPoint> Observe(int frame) {
    std::vector<TrackedPoint> seen;
    for (int i = 0; i < kPoints; ++i) {
      const auto pixel = camera_.Project(PoseAt(frame).Inverse() * points_[i]);
      if (!pixel || !camera_.IsInImage(*pixel)) continue;
      const Eigen::Vector2d noise(noise_(random_), noise_(random_));
      seen.push_back({TrackId(static_cast<uint32_t>(i)), *pixel + noise, 0.5, frame});
    }
    return seen;
  }
  void Feed(LandmarkInitializer* initializer, int frames) {
    for (frame_ = 0; frame_ < frames; ++frame_) {
      initializer->AddFrame(PoseAt(frame_), Observe(frame_));
    }
    --frame_;
  }
  double TrueInverseDepth(TrackId track) const {
    return 1 / (PoseAt(frame_).Inverse() * points_[track.value()]).norm();
  }
  const CameraModel& camera() const { return camera_; }

 private:
  const CameraModel camera_ = MakeTestCamera();
  std::mt19937_64 random_{11};
  std::normal_distribution<double> noise_;
  std::vector<Eigen::Vector3d> points_;
  int frame_ = 0;
};

LandmarkInitializerOptions With(InitializationMethod method) {
  LandmarkInitializerOptions options;
  options.method = method;
  return options;
}

std::vector<TrackId> AllTracks() {
  std::vector<TrackId> tracks;
  for (uint32_t i = 0; i < kPoints; ++i) tracks.push_back(TrackId(i));
  return tracks;
}

// Root mean square of the depths' relative errors, and of the errors over their sigmas.
std::pair<double, double> ErrorsOf(const std::vector<MeasuredDepth>& depths,
                                   const Passage& passage) {
  double relative = 0, normalised = 0;
  for (const MeasuredDepth& depth : depths) {
    const double truth = passage.TrueInverseDepth(depth.track);
    const double error = depth.inverse_depth - truth;
    relative += error * error / (truth * truth);
    normalised += error * error / (depth.sigma * depth.sigma);
  }
  const auto count = static_cast<double>(depths.size());
  return {std::sqrt(relative / count), std::sqrt(normalised / count)};
}

class EveryDelayedMethod : public testing::TestWithParam<InitializationMethod> {};

TEST_P(EveryDelayedMethod, MeasuresDepthsOnceThereIsParallax) {
  Passage passage;
  LandmarkInitializer initializer(With(GetParam()), passage.camera());
  passage.Feed(&initializer, 31);
  std::vector<TrackId> tracks = AllTracks();
  const auto depths = initializer.Measure(&tracks);
  ASSERT_GE(depths.size(), 30u);
  EXPECT_EQ(depths.size(), tracks.size());
  const auto [relative, normalised] = ErrorsOf(depths, passage);
  EXPECT_LT(relative, 0.05);
  EXPECT_LT(normalised, 1.5);
}

TEST_P(EveryDelayedMethod, WaitsForParallax) {
  Passage passage;
  LandmarkInitializer initializer(With(GetParam()), passage.camera());
  passage.Feed(&initializer, 6);
  std::vector<TrackId> tracks = AllTracks();
  EXPECT_TRUE(initializer.Measure(&tracks).empty());
  EXPECT_TRUE(tracks.empty());
  EXPECT_TRUE(initializer.IsDelayed(30));
  EXPECT_FALSE(initializer.IsDelayed(5));
}

TEST_P(EveryDelayedMethod, DepthsDoNotDependOnTheFrameButOnTheUnit) {
  std::vector<std::vector<MeasuredDepth>> found;
  for (bool changed : {false, true}) {
    Passage passage;
    LandmarkInitializer initializer(With(GetParam()), passage.camera());
    passage.Feed(&initializer, 31);
    if (changed) {
      initializer.Rebase({RotationExp({0.4, -0.2, 0.9}), Eigen::Vector3d(3, -2, 1)});
      initializer.Rescale(2.5);
    }
    std::vector<TrackId> tracks = AllTracks();
    found.push_back(initializer.Measure(&tracks));
  }
  ASSERT_EQ(found[0].size(), found[1].size());
  for (size_t i = 0; i < found[0].size(); ++i) {
    EXPECT_NEAR(found[0][i].inverse_depth, 2.5 * found[1][i].inverse_depth, 1e-6);
    EXPECT_NEAR(found[0][i].sigma, 2.5 * found[1][i].sigma, 1e-6);
  }
}

TEST_P(EveryDelayedMethod, RefusesAMismatch) {
  Passage passage;
  LandmarkInitializer initializer(With(GetParam()), passage.camera());
  passage.Feed(&initializer, 30);
  std::vector<TrackedPoint> points = passage.Observe(30);
  const TrackId wrong = points[10].track;
  points[10].pixel.y() += 40;
  initializer.AddFrame(passage.PoseAt(30), points);
  std::vector<TrackId> tracks = AllTracks();
  initializer.Measure(&tracks);
  if (GetParam() != InitializationMethod::kMultiView) {
    EXPECT_EQ(std::count(tracks.begin(), tracks.end(), wrong), 0);
  }
  EXPECT_GE(tracks.size(), 25u);
}

INSTANTIATE_TEST_SUITE_P(All, EveryDelayedMethod,
                         testing::Values(InitializationMethod::kTwoView,
                                         InitializationMethod::kMultiView,
                                         InitializationMethod::kTwoViewUpdate));

TEST(LandmarkInitializer, UndelayedNeverWaitsAndKeepsNothing) {
  Passage passage;
  LandmarkInitializer initializer({}, passage.camera());
  passage.Feed(&initializer, 31);
  EXPECT_FALSE(initializer.IsDelayed(50));
  EXPECT_FALSE(initializer.IsReady(TrackId(3)));
}

// Chen's update in full: the new landmark's error is the pose's plus its own, and the observation
// from two-view geometry is relative to the camera. The gain for the pose is zero, and that for the
// depth is FuseDepths'.
TEST(FuseDepths, IsTheKalmanUpdateOfANewLandmark) {
  const double pose_variance = 0.7;
  const DepthEstimate first{0.4, 0.05}, second{0.46, 0.03};
  Eigen::Matrix2d p;  // of position along the ray, and of the landmark
  p << pose_variance, pose_variance, pose_variance, pose_variance + first.sigma * first.sigma;
  const Eigen::RowVector2d h(-1, 1);
  const double s = h * p * h.transpose() + second.sigma * second.sigma;
  const Eigen::Vector2d gain = p * h.transpose() / s;
  const double innovation = second.inverse_depth - first.inverse_depth;
  EXPECT_NEAR(gain[0], 0, 1e-15);
  const DepthEstimate fused = FuseDepths(first, second);
  EXPECT_NEAR(fused.inverse_depth, first.inverse_depth + gain[1] * innovation, 1e-15);
  const Eigen::Matrix2d updated = p - gain * s * gain.transpose();
  EXPECT_NEAR(fused.sigma * fused.sigma, h * updated * h.transpose(), 1e-15);
}

TEST(LandmarkInitializerOptions, RejectsNonsense) {
  EXPECT_TRUE(LandmarkInitializerOptions().Validate().ok());
  for (const auto& spoil : std::vector<void (*)(LandmarkInitializerOptions*)>{
           [](auto* o) { o->min_parallax_rad = 0; }, [](auto* o) { o->max_sigma_ratio = -1; },
           [](auto* o) { o->view_interval_frames = 0; }, [](auto* o) { o->max_views = 0; },
           [](auto* o) { o->pixel_sigma_px = std::nan(""); },
           [](auto* o) { o->min_landmarks = -1; }}) {
    LandmarkInitializerOptions options;
    spoil(&options);
    EXPECT_FALSE(options.Validate().ok());
  }
}

// The depth of a new landmark has its own variance, and the error of scale that all share.
TEST(LocalFilter, NewLandmarksStartWithAMeasuredDepth) {
  PointWorld world({}, MakeTestCamera(), SwayingTrajectory(0.3, 0.2, 3));
  auto filter = LocalFilter::Create({}, MakeTestCamera(), nullptr).value();
  world.Start(filter.get());
  for (int i = 0; i < 60; ++i) world.Step(filter.get());
  const std::vector<Landmark>& known = filter->state().landmarks();
  const std::vector<TrackId> room = {known[0].track, known[1].track};
  filter->RemoveLandmarks(room);
  const TrackId with(500000), without(500001);
  const std::vector<Measurement> measurements = {{with, {300, 200}, 1}, {without, {200, 300}, 1}};
  const std::vector<MeasuredDepth> depths = {{with, 1.7, 0.02}};
  ASSERT_EQ(filter->AddLandmarks(measurements, depths), 2);
  std::map<TrackId, LandmarkEstimate> added;
  for (const LandmarkEstimate& l : filter->Landmarks()) added[l.track] = l;
  EXPECT_NEAR(added.at(with).inverse_depth, 1.7, 1e-12);
  EXPECT_GE(added.at(with).inverse_depth_sigma, 0.02);
  EXPECT_LT(added.at(with).inverse_depth_sigma, 0.4);
  // The other one has the prior.
  EXPECT_NE(added.at(without).inverse_depth, 1.7);
  EXPECT_GT(added.at(without).inverse_depth_sigma, added.at(without).inverse_depth);
  EXPECT_TRUE(filter->state().IsCovarianceValid());
}

}  // namespace
}  // namespace portolan
