#include "agent/landmarks/track_places.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <random>

#include "common/geometry/rotation3.h"
#include "tests/agent/filter/point_world.h"
#include "tests/support/matchers.h"

namespace portolan {
namespace {

constexpr int kWallPoints = 60;

// Points before a camera that moves sideways; its poses are known.
class Wall {
 public:
  explicit Wall(double noise_px = 0) : noise_(0, noise_px > 0 ? noise_px : 1e-9) {
    std::uniform_real_distribution<double> uniform(-1, 1);
    for (int i = 0; i < kWallPoints; ++i) {
      const double x = 1.5 * uniform(random_), y = uniform(random_);
      points_.emplace_back(x, y, 4 + uniform(random_));
    }
  }
  static Rigid3 PoseAt(int keyframe) {
    return {RotationExp({0, 0.01 * keyframe, 0}), Eigen::Vector3d(0.1 * keyframe, 0.02, 0)};
  }
  std::vector<TrackedPoint> Observe(const Rigid3& world_from_camera) {
    std::vector<TrackedPoint> seen;
    for (int i = 0; i < kWallPoints; ++i) {
      const auto pixel = camera_.Project(world_from_camera.Inverse() * points_[i]);
      if (!pixel || !camera_.IsInImage(*pixel)) continue;
      const Eigen::Vector2d noise(noise_(random_), noise_(random_));
      seen.push_back({TrackId(static_cast<uint32_t>(i)), *pixel + noise, 0.5, 1});
    }
    return seen;
  }
  Eigen::Vector2d PixelOf(TrackId track, const Rigid3& world_from_camera) const {
    return *camera_.Project(world_from_camera.Inverse() * points_[track.value()]);
  }
  void Feed(TrackPlaces* tracks, int keyframes) {
    for (int i = 0; i < keyframes; ++i) tracks->AddKeyframe(PoseAt(i), Observe(PoseAt(i)));
  }
  const CameraModel& camera() const { return camera_; }
  static std::vector<TrackId> AllTracks() {
    std::vector<TrackId> all;
    for (uint32_t i = 0; i < kWallPoints; ++i) all.push_back(TrackId(i));
    return all;
  }

 private:
  const CameraModel camera_ = MakeTestCamera();
  std::mt19937_64 random_{5};
  std::normal_distribution<double> noise_;
  std::vector<Eigen::Vector3d> points_;
};

TEST(TrackPlacesTest, ExpectsThemWhereTheyAre) {
  Wall wall;
  TrackPlaces tracks({}, wall.camera());
  wall.Feed(&tracks, 6);
  const Rigid3 back = Wall::PoseAt(1);
  const auto expected = tracks.ExpectLost(back, Wall::AllTracks());
  ASSERT_GT(expected.size(), 20u);
  for (const SearchRegion& region : expected) {
    EXPECT_THAT((region.pixel - wall.PixelOf(region.track, back)).norm(), testing::Lt(1e-6));
  }
}

TEST(TrackPlacesTest, ErrorsLieWithinTheSearchEllipse) {
  Wall wall(0.7);
  TrackPlaces tracks({.drift_sigma_px = 0.1}, wall.camera());
  wall.Feed(&tracks, 6);
  int checked = 0, inside = 0;
  for (const SearchRegion& region : tracks.ExpectLost(Wall::PoseAt(0), Wall::AllTracks())) {
    const Eigen::Vector2d error = region.pixel - wall.PixelOf(region.track, Wall::PoseAt(0));
    const double chi2 = error.dot(region.covariance_px2.inverse() * error);
    ++checked;
    if (chi2 < 9) ++inside;
  }
  EXPECT_GT(checked, 20);
  EXPECT_GE(inside, 0.95 * checked);
}

TEST(TrackPlacesTest, OnlyLostTracksAreLookedFor) {
  Wall wall;
  TrackPlaces tracks({.max_searched = 5}, wall.camera());
  wall.Feed(&tracks, 6);
  EXPECT_EQ(tracks.ExpectLost(Wall::PoseAt(5), Wall::AllTracks()).size(), 5u);
  EXPECT_TRUE(tracks.ExpectLost(Wall::PoseAt(5), {}).empty());
  const std::vector<TrackId> lost = {wall.Observe(Wall::PoseAt(5))[3].track};
  const auto expected = tracks.ExpectLost(Wall::PoseAt(5), lost);
  ASSERT_EQ(expected.size(), 1u);
  EXPECT_EQ(expected[0].track, lost[0]);
}

TEST(TrackPlacesTest, FromElsewhereAPointLooksOtherwise) {
  Wall wall;
  TrackPlaces tracks({.pixel_sigma_px = 0.1}, wall.camera());
  wall.Feed(&tracks, 6);
  Rigid3 near = Wall::PoseAt(5), aside = Wall::PoseAt(5);
  near.translation.z() += 2.6;
  aside.translation.x() += 4;
  aside.rotation = aside.rotation * RotationExp({0, -0.8, 0});
  EXPECT_GT(tracks.PredictLive(near).size(), 3u);
  EXPECT_TRUE(tracks.ExpectLost(near, Wall::AllTracks()).empty());
  EXPECT_GT(tracks.PredictLive(aside).size(), 3u);
  EXPECT_TRUE(tracks.ExpectLost(aside, Wall::AllTracks()).empty());
}

TEST(TrackPlacesTest, AnotherFrameAndUnitMeanTheSamePixels) {
  Wall wall;
  TrackPlaces tracks({}, wall.camera()), moved({}, wall.camera());
  wall.Feed(&tracks, 6);
  wall.Feed(&moved, 6);
  const Rigid3 old_from_new{RotationExp({0.3, -0.5, 0.2}), Eigen::Vector3d(3, -1, 2)};
  moved.Rebase(old_from_new);
  moved.Rescale(2.5);
  Rigid3 camera = old_from_new.Inverse() * Wall::PoseAt(1);
  camera.translation *= 2.5;
  const auto before = tracks.ExpectLost(Wall::PoseAt(1), Wall::AllTracks());
  const auto after = moved.ExpectLost(camera, Wall::AllTracks());
  ASSERT_GT(before.size(), 20u);
  ASSERT_EQ(before.size(), after.size());
  for (size_t i = 0; i < before.size(); ++i) {
    EXPECT_EQ(before[i].track, after[i].track);
    EXPECT_LT((before[i].pixel - after[i].pixel).norm(), 1e-5);
    EXPECT_LT((before[i].covariance_px2 - after[i].covariance_px2).norm(), 1e-4);
    EXPECT_LT((before[i].warp - after[i].warp).norm(), 1e-6);
  }
}

// Where the image has turned by a right angle about the axis, so has what surrounds a point.
TEST(TrackPlacesTest, WarpTurnsWithTheCamera) {
  Wall wall;
  TrackPlaces tracks({}, wall.camera());
  wall.Feed(&tracks, 6);
  Rigid3 turned = Wall::PoseAt(5);
  turned.rotation = turned.rotation * RotationExp({0, 0, EIGEN_PI / 2});
  const auto expected = tracks.ExpectLost(turned, Wall::AllTracks());
  ASSERT_GT(expected.size(), 10u);
  for (const SearchRegion& region : expected) {
    // The point's surroundings: what lies beside it across the ray.
    EXPECT_NEAR(region.warp.determinant(), 1, 0.2) << region.track.value();
    const Eigen::Vector2d axis = region.warp.col(0).normalized();
    EXPECT_LT(std::abs(axis.x()), 0.2);
    EXPECT_LT(axis.y(), -0.9);
  }
}

// A track that slipped from one point to another has no place, and is said to have slipped.
TEST(TrackPlacesTest, RaysThatMissEachOtherGiveNoPlace) {
  Wall wall;
  TrackPlaces tracks({}, wall.camera());
  const TrackId slipped = wall.Observe(Wall::PoseAt(0)).front().track;
  std::vector<TrackId> told;
  for (int i = 0; i < 6; ++i) {
    auto points = wall.Observe(Wall::PoseAt(i));
    if (i >= 3) points.front().pixel.y() += 12;
    for (const TrackId track : tracks.AddKeyframe(Wall::PoseAt(i), points)) told.push_back(track);
  }
  ASSERT_FALSE(told.empty());
  for (const TrackId track : told) EXPECT_EQ(track, slipped);
  const auto expected = tracks.ExpectLost(Wall::PoseAt(2), Wall::AllTracks());
  ASSERT_GT(expected.size(), 20u);
  for (const SearchRegion& region : expected) EXPECT_NE(region.track, slipped);
}

TEST(TrackPlacesTest, PredictsThoseOfTheLastKeyframe) {
  Wall wall;
  TrackPlaces tracks({}, wall.camera());
  wall.Feed(&tracks, 5);
  auto some = wall.Observe(Wall::PoseAt(5));
  some.resize(30);
  tracks.AddKeyframe(Wall::PoseAt(5), some);
  const auto predictions = tracks.PredictLive(Wall::PoseAt(6));
  ASSERT_GT(predictions.size(), 20u);
  EXPECT_LE(predictions.size(), 30u);
  for (const TrackPrediction& prediction : predictions) {
    EXPECT_LT((prediction.pixel - wall.PixelOf(prediction.track, Wall::PoseAt(6))).norm(), 1e-6);
  }
}

TEST(TrackPlacesTest, WithoutParallaxNoPlace) {
  Wall wall;
  TrackPlaces tracks({}, wall.camera());
  for (int i = 0; i < 6; ++i) {
    const Rigid3 turning{RotationExp({0, 0.02 * i, 0}), Eigen::Vector3d::Zero()};
    tracks.AddKeyframe(turning, wall.Observe(turning));
  }
  EXPECT_TRUE(tracks.ExpectLost(Rigid3::Identity(), Wall::AllTracks()).empty());
}

TEST(TrackPlacesTest, ForgetsThoseNotSeenForLongest) {
  Wall wall;
  TrackPlaces tracks({.max_tracks = 10}, wall.camera());
  TrackPlaces all({}, wall.camera());
  wall.Feed(&tracks, 5);
  wall.Feed(&all, 5);
  const std::vector<TrackedPoint> seen = wall.Observe(Wall::PoseAt(5));
  ASSERT_GT(seen.size(), 20u);
  const TrackId first_of_last = seen[seen.size() - 10].track;
  for (int i = 5; i < 8; ++i) {
    std::vector<TrackedPoint> last = wall.Observe(Wall::PoseAt(i));
    std::erase_if(last, [&](const TrackedPoint& point) { return point.track < first_of_last; });
    tracks.AddKeyframe(Wall::PoseAt(i), last);
  }
  EXPECT_GT(all.ExpectLost(Wall::PoseAt(4), Wall::AllTracks()).size(), 20u);
  const auto expected = tracks.ExpectLost(Wall::PoseAt(4), Wall::AllTracks());
  ASSERT_GT(expected.size(), 3u);
  for (const SearchRegion& region : expected) EXPECT_GE(region.track, first_of_last);
}

TEST(TrackPlacesTest, DisabledItKnowsNothing) {
  Wall wall;
  TrackPlaces tracks({.enabled = false}, wall.camera());
  wall.Feed(&tracks, 6);
  EXPECT_TRUE(tracks.PredictLive(Wall::PoseAt(5)).empty());
  EXPECT_TRUE(tracks.ExpectLost(Wall::PoseAt(5), Wall::AllTracks()).empty());
}

TEST(TrackPlacesOptions, RefusesNonsense) {
  EXPECT_TRUE(TrackPlacesOptions().Validate().ok());
  EXPECT_FALSE(TrackPlacesOptions{.max_tracks = 0}.Validate().ok());
  EXPECT_FALSE(TrackPlacesOptions{.max_distance_factor = 1}.Validate().ok());
}

}  // namespace
}  // namespace portolan
