#include "agent/tracker/tracker.h"

#include <gtest/gtest.h>

#include <map>

#include "tests/agent/tracker/test_images.h"

namespace portolan {
namespace {

constexpr int kWidth = 240, kHeight = 180;
const Eigen::Quaterniond kNoRotation = Eigen::Quaterniond::Identity();

std::unique_ptr<Tracker> MakeTracker(int max_points = 40,
                                     MatcherType matcher = MatcherType::kPyramidalFlow) {
  TrackerOptions options;
  options.matcher = matcher;
  options.max_points = max_points;
  auto tracker = Tracker::Create(options, TestCamera(kWidth, kHeight));
  PORTOLAN_CHECK(tracker.ok());
  return std::move(*tracker);
}

// Where each live track's point lies on the texture, by the view it was detected in.
class Truth {
 public:
  void Learn(const Tracker& tracker, const View& view) {
    for (const TrackedPoint& p : tracker.points())
      on_texture_.try_emplace(p.track, view.Unmap(p.pixel));
  }
  // Errors of the tracks that are at least min_age old.
  std::vector<double> Errors(const Tracker& tracker, const View& view, int min_age) const {
    std::vector<double> errors;
    for (const TrackedPoint& p : tracker.points()) {
      if (p.age_frames < min_age) continue;
      errors.push_back((view.Map(on_texture_.at(p.track)) - p.pixel).norm());
    }
    return errors;
  }

 private:
  std::map<TrackId, Eigen::Vector2d> on_texture_;
};

double Largest(const std::vector<double>& v) { return *std::max_element(v.begin(), v.end()); }

View ViewAt(int frame) {
  const double t = 0.06 * frame;
  const Eigen::Vector2d centre(kWidth / 2, kHeight / 2);
  View view{.affine = RotationScale(0.25 * std::sin(0.7 * t), 1.0 + 0.15 * std::sin(t))};
  view.shift =
      centre - view.affine * centre + Eigen::Vector2d(14 * std::sin(1.3 * t), 9 * std::sin(t));
  return view;
}

void ExpectOk(const Status& status) { EXPECT_TRUE(status.ok()) << status; }

TEST(Tracker, DoesNotDriftOver150Frames) {
  const WaveTexture texture(17);
  const auto tracker = MakeTracker();
  Truth truth;
  for (int frame = 0; frame <= 150; ++frame) {
    const View view = ViewAt(frame);
    ExpectOk(tracker->Track(Render(texture, view, kWidth, kHeight), {}, kNoRotation));
    if (frame == 0) tracker->Detect();
    truth.Learn(*tracker, view);
  }
  const auto errors = truth.Errors(*tracker, ViewAt(150), 150);
  ASSERT_GE(errors.size(), 15u);
  EXPECT_LT(Largest(errors), 0.15);
}

TEST(Tracker, ActiveSearchDoesNotDriftEither) {
  const WaveTexture texture(17);
  const auto tracker = MakeTracker(40, MatcherType::kActiveSearch);
  Truth truth;
  for (int frame = 0; frame <= 60; ++frame) {
    const View view = ViewAt(frame);
    ExpectOk(tracker->Track(Render(texture, view, kWidth, kHeight), {}, kNoRotation));
    if (frame == 0) tracker->Detect();
    truth.Learn(*tracker, view);
  }
  const auto errors = truth.Errors(*tracker, ViewAt(60), 60);
  ASSERT_GE(errors.size(), 15u);
  EXPECT_LT(Largest(errors), 0.15);
}

// Predictions 5.7 px off with ellipses of this variance: how many tracks are found, and how well.
std::pair<size_t, double> FoundWithVariance(double variance_px2) {
  const WaveTexture texture(19);
  const auto tracker = MakeTracker(40, MatcherType::kActiveSearch);
  ExpectOk(tracker->Track(Render(texture, {}, kWidth, kHeight), {}, kNoRotation));
  tracker->Detect();
  Truth truth;
  truth.Learn(*tracker, {});
  const View moved{.shift = {40.0, 25.0}};
  std::vector<TrackPrediction> predictions;
  for (const TrackedPoint& p : tracker->points()) {
    predictions.push_back({p.track, moved.Map(p.pixel) + Eigen::Vector2d(4.0, -4.0),
                           variance_px2 * Eigen::Matrix2d::Identity()});
  }
  ExpectOk(tracker->Track(Render(texture, moved, kWidth, kHeight), predictions, kNoRotation));
  const auto errors = truth.Errors(*tracker, moved, 1);
  return {errors.size(), errors.empty() ? 0.0 : Largest(errors)};
}

TEST(Tracker, ActiveSearchLooksInThePredictedEllipseOnly) {
  const auto [found, error] = FoundWithVariance(9.0);
  EXPECT_GE(found, 20u);
  EXPECT_LT(error, 0.1);
  EXPECT_LE(FoundWithVariance(0.25).first, 2u);
}

TEST(Tracker, SurvivesExposureChanges) {
  const WaveTexture texture(18, 30.0);
  const auto tracker = MakeTracker();
  Truth truth;
  View view;
  for (int frame = 0; frame <= 30; ++frame) {
    view = ViewAt(frame);
    view.gain = 1.0 - 0.02 * frame;
    view.offset = frame % 10 == 5 ? 30.0 : 0.0;
    ExpectOk(tracker->Track(Render(texture, view, kWidth, kHeight), {}, kNoRotation));
    if (frame == 0) tracker->Detect();
    truth.Learn(*tracker, view);
  }
  const auto errors = truth.Errors(*tracker, view, 30);
  ASSERT_GE(errors.size(), 20u);
  EXPECT_LT(Largest(errors), 0.2);
}

TEST(Tracker, UsesPredictionsWhereTheMotionIsLarge) {
  const WaveTexture texture(19);
  const auto tracker = MakeTracker();
  ExpectOk(tracker->Track(Render(texture, {}, kWidth, kHeight), {}, kNoRotation));
  tracker->Detect();
  Truth truth;
  truth.Learn(*tracker, {});
  const View moved{.shift = {60.0, 35.0}};
  std::vector<TrackPrediction> predictions;
  for (const TrackedPoint& p : tracker->points()) {
    predictions.push_back({p.track, moved.Map(p.pixel) + Eigen::Vector2d(2.0, -2.5)});
  }
  predictions.push_back({TrackId(999), {5, 5}});
  predictions.push_back({tracker->points()[0].track, {std::nan(""), 0}});
  ExpectOk(tracker->Track(Render(texture, moved, kWidth, kHeight), predictions, kNoRotation));
  const auto errors = truth.Errors(*tracker, moved, 1);
  ASSERT_GE(errors.size(), 12u);
  EXPECT_LT(Largest(errors), 0.1);
}

TEST(Tracker, FollowsFastRotationWithAPrior) {
  const WaveTexture texture(20);
  const CameraModel camera = TestCamera(kWidth, kHeight);
  const auto tracker = MakeTracker();
  // A roll about the optical axis is an exact rotation of the image.
  const double angle = 0.2;
  const Eigen::Vector2d centre(camera.intrinsics().cx_px, camera.intrinsics().cy_px);
  View rolled{.affine = RotationScale(angle, 1.0)};
  rolled.shift = centre - rolled.affine * centre;
  ExpectOk(tracker->Track(Render(texture, {}, kWidth, kHeight), {}, kNoRotation));
  tracker->Detect();
  Truth truth;
  truth.Learn(*tracker, {});
  const Eigen::Quaterniond previous_from_current(
      Eigen::AngleAxisd(-angle, Eigen::Vector3d::UnitZ()));
  ExpectOk(tracker->Track(Render(texture, rolled, kWidth, kHeight), {}, previous_from_current));
  const auto errors = truth.Errors(*tracker, rolled, 1);
  ASSERT_GE(errors.size(), 20u);
  EXPECT_LT(Largest(errors), 0.35);
}

TEST(Tracker, LosesWhatIsOccludedAndFindsItAgain) {
  const WaveTexture texture(22);
  const auto tracker = MakeTracker();
  const cv::Mat image = Render(texture, {}, kWidth, kHeight);
  ExpectOk(tracker->Track(image, {}, kNoRotation));
  const size_t all = tracker->Detect().size();
  cv::Mat covered = image.clone();
  covered.colRange(0, kWidth / 2).setTo(90);
  const std::vector<TrackedPoint> before = tracker->points();
  ExpectOk(tracker->Track(covered, {}, kNoRotation));
  EXPECT_LT(tracker->points().size(), 0.65 * all);
  const View moved{.shift = {5.3, 4.2}};
  ExpectOk(tracker->Track(Render(texture, moved, kWidth, kHeight), {}, kNoRotation));
  const size_t alive = tracker->points().size();
  std::vector<SearchRegion> regions = {{TrackId(12345), {50, 50}, Eigen::Matrix2d::Identity()}};
  size_t in_view = 0;
  for (const TrackedPoint& p : before) {
    regions.push_back({p.track, p.pixel, 9.0 * Eigen::Matrix2d::Identity()});
    in_view += TestCamera(kWidth, kHeight).IsInImage(moved.Map(p.pixel), 11.0);
  }
  const auto revived = tracker->Reacquire(regions);
  EXPECT_GE(alive + revived.size(), 0.95 * in_view);
  EXPECT_GE(revived.size(), 0.3 * all);
  EXPECT_EQ(tracker->points().size(), alive + revived.size());
  for (const TrackedPoint& p : tracker->points()) {
    const auto first = std::find_if(before.begin(), before.end(),
                                    [&](const TrackedPoint& b) { return b.track == p.track; });
    ASSERT_NE(first, before.end());
    EXPECT_LT((moved.Map(first->pixel) - p.pixel).norm(), 0.15);
  }
}

// After a turn by a right angle only a patch that is turned as well is found.
TEST(Tracker, FindsAgainWhatLooksTurned) {
  const WaveTexture texture(22);
  const auto tracker = MakeTracker();
  ExpectOk(tracker->Track(Render(texture, {}, kWidth, kHeight), {}, kNoRotation));
  tracker->Detect();
  const std::vector<TrackedPoint> before = tracker->points();
  ExpectOk(tracker->Track(cv::Mat(kHeight, kWidth, CV_8UC1, cv::Scalar(90)), {}, kNoRotation));
  EXPECT_TRUE(tracker->points().empty());
  const Eigen::Vector2d centre(kWidth / 2, kHeight / 2);
  View turned{.affine = RotationScale(0.5 * M_PI, 1.0)};
  turned.shift = centre - turned.affine * centre;
  ExpectOk(tracker->Track(Render(texture, turned, kWidth, kHeight), {}, kNoRotation));
  std::vector<SearchRegion> regions;
  for (const TrackedPoint& p : before) {
    const Eigen::Vector2d pixel = turned.Map(p.pixel);
    if (!TestCamera(kWidth, kHeight).IsInImage(pixel, 11.0)) continue;
    regions.push_back({p.track, pixel + Eigen::Vector2d(1, -1), Eigen::Matrix2d::Identity()});
  }
  ASSERT_GE(regions.size(), 10u);
  EXPECT_EQ(tracker->lost().size(), before.size());
  EXPECT_LT(tracker->Reacquire(regions).size(), 0.3 * regions.size());
  for (SearchRegion& region : regions) region.warp = turned.affine;
  tracker->Reacquire(regions);
  EXPECT_GE(tracker->points().size(), 0.9 * regions.size());
}

std::vector<TrackPrediction> PredictAll(const Tracker& tracker, const Eigen::Vector2d& offset) {
  std::vector<TrackPrediction> predictions;
  for (const TrackedPoint& p : tracker.points()) {
    predictions.push_back({p.track, p.pixel + offset, 0.25 * Eigen::Matrix2d::Identity()});
  }
  return predictions;
}

TEST(Tracker, OthersWaitForTheSecondStep) {
  const WaveTexture texture(23);
  const auto tracker = MakeTracker();
  const cv::Mat image = Render(texture, {}, kWidth, kHeight);
  ExpectOk(tracker->Track(image, {}, kNoRotation));
  const size_t count = tracker->Detect().size();
  ASSERT_GE(count, 20u);
  const auto predictions = PredictAll(*tracker, Eigen::Vector2d::Zero());
  ExpectOk(tracker->TrackPredicted(image, {predictions.data(), 5}, kNoRotation));
  EXPECT_EQ(tracker->points().size(), 5u);
  tracker->TrackOthers({}, kNoRotation);
  EXPECT_EQ(tracker->points().size(), count);
}

// What is found away from where a point of known place must be is another point.
TEST(Tracker, OthersFoundElsewhereAreLost) {
  const WaveTexture texture(23);
  const auto tracker = MakeTracker();
  const cv::Mat image = Render(texture, {}, kWidth, kHeight);
  ExpectOk(tracker->Track(image, {}, kNoRotation));
  tracker->Detect();
  // Flow leads back from ten pixels off to the point itself, which is then in the wrong place.
  const auto wrong = PredictAll(*tracker, {8.0, 6.0});
  ASSERT_GE(wrong.size(), 20u);
  ExpectOk(tracker->TrackPredicted(image, {}, kNoRotation));
  tracker->TrackOthers({wrong.data(), 3}, kNoRotation);
  EXPECT_EQ(tracker->points().size(), wrong.size() - 3);
}

TEST(Tracker, WhereManySlipNoneOfUnknownPlaceIsBelieved) {
  const WaveTexture texture(23);
  const auto tracker = MakeTracker();
  const cv::Mat image = Render(texture, {}, kWidth, kHeight);
  ExpectOk(tracker->Track(image, {}, kNoRotation));
  tracker->Detect();
  auto predictions = PredictAll(*tracker, Eigen::Vector2d::Zero());
  ASSERT_GE(predictions.size(), 20u);
  for (size_t i = 0; i < 8; ++i) predictions[i].pixel += Eigen::Vector2d(8.0, 6.0);
  ExpectOk(tracker->TrackPredicted(image, {}, kNoRotation));
  tracker->TrackOthers({predictions.data(), 14}, kNoRotation);
  EXPECT_EQ(tracker->points().size(), 6u);
}

TEST(Tracker, DroppedTracksDoNotComeBack) {
  const WaveTexture texture(23);
  const auto tracker = MakeTracker();
  ExpectOk(tracker->Track(Render(texture, {}, kWidth, kHeight), {}, kNoRotation));
  const auto ids = tracker->Detect();
  ASSERT_FALSE(ids.empty());
  const TrackedPoint first = tracker->points()[0];
  const std::vector<TrackId> drop = {first.track, TrackId(4711)};
  tracker->Drop(drop);
  EXPECT_EQ(tracker->points().size(), ids.size() - 1);
  const SearchRegion region{first.track, first.pixel, Eigen::Matrix2d::Identity()};
  EXPECT_TRUE(tracker->Reacquire({&region, 1}).empty());
}

TEST(Tracker, FollowsAPixelThatIsNoCorner) {
  const WaveTexture texture(17);
  const auto tracker = MakeTracker();
  EXPECT_FALSE(tracker->StartAt({100, 100}));  // no image yet
  const Eigen::Vector2d pixel(131.3, 87.6);
  std::optional<TrackId> track;
  for (int frame = 0; frame <= 30; ++frame) {
    ExpectOk(tracker->Track(Render(texture, ViewAt(frame), kWidth, kHeight), {}, kNoRotation));
    if (frame == 0) track = tracker->StartAt(pixel);
    ASSERT_TRUE(track);
    ASSERT_EQ(tracker->points().size(), 1u);
    EXPECT_EQ(tracker->points()[0].track, *track);
  }
  EXPECT_EQ(tracker->points()[0].age_frames, 30);
  EXPECT_LT((ViewAt(30).Map(ViewAt(0).Unmap(pixel)) - tracker->points()[0].pixel).norm(), 0.15);
  // Beyond the image, and where it shows nothing.
  EXPECT_FALSE(tracker->StartAt({3, 87}));
  EXPECT_FALSE(tracker->StartAt({-1e9, 87}));
  ExpectOk(tracker->Track(cv::Mat(kHeight, kWidth, CV_8UC1, cv::Scalar(90)), {}, kNoRotation));
  EXPECT_FALSE(tracker->StartAt(pixel));
}

TEST(Tracker, GivesTheYoungerUpWhenTwoTracksMeet) {
  // Zooming out by half draws all points together; none may end nearer than the limit.
  const WaveTexture texture(24);
  const auto tracker = MakeTracker(400);
  for (int frame = 0; frame <= 25; ++frame) {
    const View view{.affine = RotationScale(0.0, 1.0 - 0.028 * frame)};
    ExpectOk(tracker->Track(Render(texture, view, kWidth, kHeight), {}, kNoRotation));
    if (frame == 0) tracker->Detect();
    const auto& points = tracker->points();
    for (size_t i = 0; i < points.size(); ++i) {
      for (size_t j = 0; j < i; ++j) {
        ASSERT_GE((points[i].pixel - points[j].pixel).norm(), TrackerOptions().merge_distance_px);
      }
    }
  }
}

TEST(Tracker, StopsAtTheImagesEdge) {
  const WaveTexture texture(25);
  const auto tracker = MakeTracker();
  for (int frame = 0; frame <= 30; ++frame) {
    const View view{.shift = {-6.0 * frame, 0.0}};
    ExpectOk(tracker->Track(Render(texture, view, kWidth, kHeight), {}, kNoRotation));
    if (frame % 5 == 0) tracker->Detect();
    for (const TrackedPoint& p : tracker->points()) ASSERT_GE(p.pixel.x(), 10.0);
    ASSERT_GE(tracker->points().size(), 20u);
  }
}

TEST(Tracker, NeverReusesIdsAndKeepsThemAscending) {
  const WaveTexture texture(26);
  const auto tracker = MakeTracker();
  uint32_t largest = 0;
  for (int frame = 0; frame < 12; ++frame) {
    const View view{.shift = {-9.0 * frame, 3.0 * frame}};
    ExpectOk(tracker->Track(Render(texture, view, kWidth, kHeight), {}, kNoRotation));
    for (const TrackId& id : tracker->Detect()) {
      EXPECT_TRUE(frame == 0 || id.value() > largest);
      largest = std::max(largest, id.value());
    }
    for (size_t i = 1; i < tracker->points().size(); ++i) {
      ASSERT_LT(tracker->points()[i - 1].track, tracker->points()[i].track);
    }
  }
}

TEST(Tracker, IsRepeatable) {
  const WaveTexture texture(27);
  const auto a = MakeTracker(), b = MakeTracker();
  for (int frame = 0; frame < 15; ++frame) {
    const cv::Mat image = Render(texture, ViewAt(2 * frame), kWidth, kHeight);
    for (Tracker* tracker : {a.get(), b.get()}) {
      ExpectOk(tracker->Track(image, {}, kNoRotation));
      tracker->Detect();
    }
    ASSERT_EQ(a->points().size(), b->points().size());
    for (size_t i = 0; i < a->points().size(); ++i) {
      ASSERT_EQ(a->points()[i].track, b->points()[i].track);
      ASSERT_EQ(a->points()[i].pixel, b->points()[i].pixel);
    }
  }
}

TEST(Tracker, RefusesWrongImagesAndGoesOn) {
  const WaveTexture texture(28);
  const auto tracker = MakeTracker();
  const cv::Mat image = Render(texture, {}, kWidth, kHeight);
  ExpectOk(tracker->Track(image, {}, kNoRotation));
  const size_t count = tracker->Detect().size();
  EXPECT_EQ(tracker->Track(cv::Mat(), {}, kNoRotation).code(), absl::StatusCode::kInvalidArgument);
  EXPECT_FALSE(tracker->Track(image.rowRange(0, 100), {}, kNoRotation).ok());
  EXPECT_FALSE(tracker->Track(cv::Mat(kHeight, kWidth, CV_8UC3), {}, kNoRotation).ok());
  EXPECT_FALSE(tracker->Track(cv::Mat(kHeight, kWidth, CV_16UC1), {}, kNoRotation).ok());
  EXPECT_EQ(tracker->points().size(), count);
  ExpectOk(tracker->Track(image, {}, kNoRotation));
  EXPECT_EQ(tracker->points().size(), count);
}

TEST(Tracker, WorksOnFlatTinyAndOddImages) {
  for (const auto& [width, height] : {std::pair(17, 13), std::pair(41, 333), std::pair(101, 67)}) {
    auto tracker = Tracker::Create({}, TestCamera(width, height));
    ASSERT_TRUE(tracker.ok());
    EXPECT_TRUE((*tracker)->Detect().empty());
    const WaveTexture texture(29);
    for (int frame = 0; frame < 4; ++frame) {
      const View view{.shift = {0.7 * frame, 0.0}};
      ExpectOk((*tracker)->Track(Render(texture, view, width, height), {}, kNoRotation));
      (*tracker)->Detect();
      (*tracker)->Describe();
    }
    ExpectOk((*tracker)->Track(cv::Mat::zeros(height, width, CV_8UC1), {}, kNoRotation));
    EXPECT_TRUE((*tracker)->points().empty());
    EXPECT_TRUE((*tracker)->Detect().empty());
  }
}

TEST(Tracker, DescribesItsTracks) {
  const WaveTexture texture(30);
  const auto tracker = MakeTracker();
  EXPECT_TRUE(tracker->Describe().empty());
  ExpectOk(tracker->Track(Render(texture, {}, kWidth, kHeight), {}, kNoRotation));
  tracker->Detect();
  const auto features = tracker->Describe();
  size_t at_full_scale = 0;
  for (const Feature& feature : features)
    at_full_scale += feature.track && feature.half_octave == 0;
  EXPECT_GE(at_full_scale, tracker->points().size() / 2);
}

}  // namespace
}  // namespace portolan
