// The agent with a laser range finder, on rendered images of a hall full of crates, whose edges the
// laser sweeps over.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <limits>

#include "agent/agent.h"
#include "common/wire/submap_wire.h"
#include "tests/agent/rendered_sequence.h"
#include "tests/support/matchers.h"
#include "tests/synthetic/ranges.h"

namespace portolan {
namespace {

using absl::StatusCode;
using testing::HasSubstr;

constexpr int kFrames = 110;

// At full size: in small images the filter's own scale wanders by some per cent within a submap.
synthetic::Mission LongMission() {
  synthetic::MissionOptions options;
  options.name = "loop";
  options.seed = 3;
  options.frames = kFrames;
  options.range_rate_hz = 10;
  return *synthetic::MakeMission(options);
}

CameraModel FullCamera() { return *CameraModel::Create(LongMission().options.camera); }

const std::vector<TimedImage>& Images() {
  static const auto* const images =
      new std::vector<TimedImage>(RenderImages(LongMission(), kFrames));
  return *images;
}

RangeFinder MakeFinder() {
  const synthetic::RangeMount mount;
  RangeFinder finder;
  finder.position_in_camera_m = mount.position_in_camera_m;
  finder.direction_in_camera = mount.direction_in_camera;
  finder.sigma_m = mount.sigma_m;
  return finder;
}

class AgentWithRanges : public testing::Test {
 protected:
  AgentWithRanges() : mission_(LongMission()) {
    for (const auto& sample : synthetic::SimulateRanges(mission_, 0)) {
      ranges_.push_back({mission_.FrameTime(0) + sample.time_since_start, sample.range_m, 0});
    }
  }

  void Run(const VehicleSensors& sensors) {
    auto agent = *Agent::Create({}, FullCamera(), AgentId("tester"), SessionId(7), sensors);
    size_t next = 0;
    submaps_.clear();
    results_.clear();
    for (const TimedImage& image : Images()) {
      for (; next < ranges_.size() && ranges_[next].time <= image.time; ++next) {
        agent->AddRanges({{ranges_[next]}});
      }
      auto result = agent->ProcessImage(image.time, image.gray);
      ASSERT_THAT(result, IsOk());
      if (result->closed_submap) submaps_.push_back(*std::move(result->closed_submap));
      results_.push_back(*std::move(result));
    }
    if (auto last = agent->Finish()) submaps_.push_back(*std::move(last));
    counts_ = agent->range_counts();
    sample_counts_ = agent->range_sample_counts();
    for (const Submap& submap : submaps_) EXPECT_THAT(EncodeSubmap(submap), IsOk());
  }
  static VehicleSensors WithFinder() {
    VehicleSensors sensors;
    sensors.range_finder = MakeFinder();
    return sensors;
  }

  // Estimated over true way along the submap's keyframes.
  double ScaleOf(const Submap& submap) const {
    double estimate = 0, truth = 0;
    for (size_t i = 1; i < submap.keyframes.size(); ++i) {
      const Keyframe &a = submap.keyframes[i - 1], &b = submap.keyframes[i];
      estimate += (b.submap_from_camera.translation - a.submap_from_camera.translation).norm();
      truth += (TrueCamera(b.time).translation - TrueCamera(a.time).translation).norm();
    }
    return estimate / truth;
  }
  Rigid3 TrueCamera(Timestamp time) const {
    return mission_.WorldFromCamera(mission_.agents[0], ToSeconds(time - mission_.FrameTime(0)));
  }

  const synthetic::Mission mission_;
  std::vector<RangeSample> ranges_;
  std::vector<Submap> submaps_;
  std::vector<FrameResult> results_;
  RangeCounts counts_;
  RangeSampleCounts sample_counts_;
};

TEST_F(AgentWithRanges, SubmapsBecomeMetric) {
  Run(WithFinder());
  int found = 0, metric = 0;
  bool was_metric = false;
  for (const FrameResult& result : results_) {
    found += result.found_scale;
    // Which counts as a beginning without predecessor, for what came before is in another unit.
    if (result.found_scale) {
      EXPECT_TRUE(result.begins_submap);
      EXPECT_NE(result.link, LinkType::kConnected);
    }
    was_metric = was_metric || result.found_scale;
    EXPECT_EQ(result.metric, was_metric);
    EXPECT_TRUE(result.tracked);
  }
  EXPECT_EQ(found, 1);
  double sum = 0;
  for (const Submap& submap : submaps_) {
    if (!submap.metric) continue;
    std::printf("submap %u: scale off by %.2f %%\n", submap.key.sequence_number,
                100 * (ScaleOf(submap) - 1));
    EXPECT_NEAR(ScaleOf(submap), 1, 0.04);
    EXPECT_FALSE(submap.gravity_in_submap);
    sum += ScaleOf(submap) - 1;
    ++metric;
  }
  ASSERT_GE(metric, 2);
  EXPECT_LT(std::abs(sum / metric), 0.02);
  std::printf("spots followed %ld, lost %ld, used %ld, rejected %ld\n",
              static_cast<long>(counts_.followed), static_cast<long>(counts_.lost),
              static_cast<long>(counts_.used), static_cast<long>(counts_.rejected));
  EXPECT_GT(counts_.used, 10);
}

TEST_F(AgentWithRanges, WithoutSamplesNothingChanges) {
  Run({});
  const std::vector<Submap> without = submaps_;
  for (const Submap& submap : without) EXPECT_FALSE(submap.metric);
  EXPECT_GT(std::abs(std::log(ScaleOf(without.back()))), 0.5);
  ranges_.clear();
  Run(WithFinder());
  ASSERT_EQ(submaps_.size(), without.size());
  for (size_t i = 0; i < without.size(); ++i) {
    EXPECT_EQ(*EncodeSubmap(submaps_[i]), *EncodeSubmap(without[i]));
  }
}

TEST_F(AgentWithRanges, DamagedSamplesAreLeftOut) {
  for (size_t i = 0; i < ranges_.size(); ++i) {
    if (i % 5 == 1) ranges_[i].range_m = std::numeric_limits<double>::quiet_NaN();
    if (i % 5 == 2) ranges_[i].range_m = 0;
    if (i % 5 == 3) ranges_[i].time = ranges_[i - 2].time - std::chrono::milliseconds(150);
  }
  Run(WithFinder());
  EXPECT_GT(sample_counts_.not_finite, 10);
  EXPECT_GT(sample_counts_.no_echo, 10);
  EXPECT_GT(sample_counts_.out_of_order, 10);
  int metric = 0;
  for (const Submap& submap : submaps_) {
    if (!submap.metric) continue;
    EXPECT_NEAR(ScaleOf(submap), 1, 0.06);
    ++metric;
  }
  EXPECT_GE(metric, 1);
}

TEST_F(AgentWithRanges, RangesOfAnotherSceneMakeNothingMetric) {
  for (size_t i = 0; i < ranges_.size(); ++i) {
    ranges_[i].range_m = 0.3 + 20 * std::abs(std::sin(7.0 * static_cast<double>(i * i)));
  }
  Run(WithFinder());
  ASSERT_FALSE(submaps_.empty());
  for (const Submap& submap : submaps_) EXPECT_FALSE(submap.metric);
}

TEST_F(AgentWithRanges, AFinderThatTheCameraNeverSeesIsRefused) {
  VehicleSensors sensors = WithFinder();
  sensors.range_finder->direction_in_camera = {1, 0, 0};
  EXPECT_THAT(Agent::Create({}, FullCamera(), AgentId("tester"), SessionId(7), sensors),
              StatusIs(StatusCode::kInvalidArgument, HasSubstr("never sees")));
}

}  // namespace
}  // namespace portolan
