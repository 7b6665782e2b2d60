// The compressed update must give what the full one gives.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "tests/agent/filter/turning_world.h"
#include "tests/support/matchers.h"

namespace portolan {
namespace {

constexpr int kPoints = 90;

std::unique_ptr<LocalFilter> MakeTurningFilter(CovarianceUpdate update) {
  FilterOptions options;
  options.max_landmarks = kPoints;
  options.covariance_update = update;
  options.linearity_threshold = 0.4;  // points soon, for only they can be passive
  return LocalFilter::Create(options, MakeTestCamera(), nullptr).value();
}

// Covariance with the motion first and the landmarks and their anchors in the order of the tracks.
Eigen::MatrixXd InOrderOfTracks(const FilterState& state) {
  std::vector<const Landmark*> landmarks;
  for (const Landmark& landmark : state.landmarks()) landmarks.push_back(&landmark);
  std::sort(landmarks.begin(), landmarks.end(),
            [](const auto* a, const auto* b) { return a->track < b->track; });
  std::vector<int> rows;
  for (int i = 0; i < state.motion_dim(); ++i) rows.push_back(i);
  for (const Landmark* landmark : landmarks) {
    for (int i = 0; i < 3; ++i) rows.push_back(state.Offset(*landmark) + i);
  }
  for (const Landmark* landmark : landmarks) {
    const int anchor = state.AnchorOffset(*landmark);
    for (int i = 0; anchor != FilterState::kFixed && i < 3; ++i) rows.push_back(anchor + i);
  }
  return state.ExpandedCovariance()(rows, rows);
}

void ExpectEqualStates(const LocalFilter& a, const LocalFilter& b) {
  ASSERT_EQ(a.landmark_count(), b.landmark_count());
  EXPECT_THAT(b.submap_from_camera(), NearRigid(a.submap_from_camera(), 1e-9));
  const Eigen::MatrixXd p = InOrderOfTracks(a.state()), q = InOrderOfTracks(b.state());
  ASSERT_EQ(p.rows(), q.rows());
  EXPECT_LT((p - q).cwiseAbs().maxCoeff(), 1e-9 * p.cwiseAbs().maxCoeff());
  const auto of_a = a.Landmarks(), of_b = b.Landmarks();
  for (size_t i = 0; i < of_a.size(); ++i) {
    ASSERT_EQ(of_a[i].track, of_b[i].track);
    ASSERT_EQ(of_a[i].euclidean, of_b[i].euclidean);
    EXPECT_NEAR(of_a[i].inverse_depth, of_b[i].inverse_depth, 1e-8);
    if (!of_a[i].euclidean) continue;
    EXPECT_THAT(of_b[i].point_in_submap, NearMatrix(of_a[i].point_in_submap, 1e-8));
    EXPECT_THAT(of_b[i].covariance, NearMatrix(of_a[i].covariance, 1e-9));
  }
}

TEST(CompressedUpdate, EqualsTheFullOneToRounding) {
  TurningWorld world(kPoints, 0.8, 6);
  auto full = MakeTurningFilter(CovarianceUpdate::kFull);
  auto compressed = MakeTurningFilter(CovarianceUpdate::kCompressed);
  int most_passive = 0, passive_frames = 0;
  for (int frame = 0; frame < 150; ++frame) {
    world.Step(frame, full.get());
    world.Step(frame, compressed.get());
    const int passive = compressed->state().passive_count();
    EXPECT_EQ(full->state().passive_count(), 0);
    most_passive = std::max(most_passive, passive);
    passive_frames += passive > 0;
    if (frame % 10 == 9) ExpectEqualStates(*full, *compressed);
    if (HasFailure()) FAIL() << "first in frame " << frame;
  }
  // It would prove nothing otherwise.
  EXPECT_GT(most_passive, 30);
  EXPECT_GT(passive_frames, 90);
}

TEST(CompressedUpdate, SurvivesHandOverAndRemovals) {
  TurningWorld world(kPoints, 0.8, 6);
  auto full = MakeTurningFilter(CovarianceUpdate::kFull);
  auto compressed = MakeTurningFilter(CovarianceUpdate::kCompressed);
  for (int frame = 0; frame < 150; ++frame) {
    for (LocalFilter* filter : {full.get(), compressed.get()}) {
      world.Step(frame, filter);
      if (frame % 40 == 39) filter->BeginSubmap();
      if (frame % 25 == 24) {
        filter->RemoveLandmarks(std::vector<TrackId>{TrackId(static_cast<uint32_t>(frame / 2))});
      }
    }
    if (frame % 10 == 4) ExpectEqualStates(*full, *compressed);
    if (HasFailure()) FAIL() << "first in frame " << frame;
  }
}

TEST(CompressedUpdate, MeasuringAPassiveLandmarkMakesItActive) {
  TurningWorld world(kPoints, 0.8, 6);
  auto filter = MakeTurningFilter(CovarianceUpdate::kCompressed);
  int frame = 0;
  while (filter->state().passive_count() < 10 && frame < 180) world.Step(frame++, filter.get());
  ASSERT_GE(filter->state().passive_count(), 10);
  TrackId passive(0);
  for (const Landmark& landmark : filter->state().landmarks()) {
    if (filter->state().IsPassive(landmark)) passive = landmark.track;
  }
  filter->Predict(world.TimeOf(frame));
  std::vector<Measurement> measurements = world.Measure(frame);
  std::erase_if(measurements, [&](const Measurement& m) { return !filter->HasLandmark(m.track); });
  measurements.push_back({passive, {320, 240}, 0.5});
  const UpdateResult result = filter->Update(measurements);
  EXPECT_EQ(std::count(result.outliers.begin(), result.outliers.end(), passive), 1);
  EXPECT_TRUE(filter->state().IsCovarianceValid());
}

}  // namespace
}  // namespace portolan
