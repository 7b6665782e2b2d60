// The whole agent, source and runner, on damaged and lying input: what it says, that the submap is
// closed and kept, and how the run ends.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <functional>
#include <limits>

#include "agent/agent_runner.h"
#include "agent/image_source/playback_source.h"
#include "common/base/logging.h"
#include "common/wire/submap_wire.h"
#include "tests/agent/rendered_sequence.h"
#include "tests/support/matchers.h"
#include "tests/support/temp_dir.h"

namespace portolan {
namespace {

using testing::AllOf;
using testing::Contains;
using testing::HasSubstr;
using testing::IsEmpty;

// One image of a sequence, or what comes instead of it.
struct ScriptedImage {
  Timestamp time{};
  StatusOr<cv::Mat> gray;
};

// A recording in memory.
class ScriptedStream : public FrameStream {
 public:
  explicit ScriptedStream(std::vector<ScriptedImage> images) : images_(std::move(images)) {}

  std::optional<FrameHeader> Advance() override {
    if (next_ == images_.size()) return std::nullopt;
    FrameHeader header;
    header.index = static_cast<int64_t>(next_);
    header.time = images_[next_].time;
    header.name = Concat("image ", next_);
    ++next_;
    if (next_ < images_.size()) header.next_time = images_[next_].time;
    return header;
  }
  StatusOr<FrameImages> Decode() override {
    PORTOLAN_ASSIGN_OR_RETURN(cv::Mat gray, images_[next_ - 1].gray);
    return FrameImages{std::move(gray), {}};
  }

 private:
  const std::vector<ScriptedImage> images_;
  size_t next_ = 0;
};

// A run over the rendered sequence with something wrong in it.
class DamagedInputTest : public testing::Test {
 protected:
  DamagedInputTest() {
    for (const TimedImage& image : RenderedImages()) images_.push_back({image.time, image.gray});
    info_.calibration.intrinsics = RenderedCamera().intrinsics();
    SetLogSink([this](LogLevel, std::string_view text) { log_.emplace_back(text); });
  }
  ~DamagedInputTest() override { SetLogSink({}); }

  Status Run() {
    {
      RunnerOptions options;
      options.server = "none";
      options.outbox = folder_ / "outbox";
      options.output = folder_ / "output";
      options.progress = false;
      auto source = std::make_unique<PlaybackSource>(source_options_, info_,
                                                     std::make_unique<ScriptedStream>(images_),
                                                     imu_, std::vector<OdometrySample>());
      auto runner = AgentRunner::Create(options, AgentOptions(), UplinkOptions(), OutboxOptions(),
                                        std::move(source));
      EXPECT_THAT(runner, IsOk());
      if (!runner.ok()) return runner.status();
      status_ = (*runner)->Run(false);
      summary_ = (*runner)->summary();
    }
    ReadOutbox();
    return status_;
  }

  void ReadOutbox() {
    for (const auto& session : Outbox::FindPendingSessions(folder_ / "outbox")) {
      const auto outbox = Outbox::Open(session, OutboxOptions());
      ASSERT_THAT(outbox, IsOk());
      for (auto i = (*outbox)->NextPending(0); i; i = (*outbox)->NextPending(*i + 1)) {
        const auto submap = DecodeSubmap((*outbox)->Read(*i).value_or(""));
        ASSERT_THAT(submap, IsOk());
        submaps_.push_back(*submap);
      }
    }
  }

  int BrokenLinks() const {
    return static_cast<int>(
        std::count_if(submaps_.begin(), submaps_.end(),
                      [](const Submap& submap) { return submap.link == LinkType::kBroken; }));
  }
  // The frame that the last submap ends with.
  Timestamp LastRecorded() const {
    return submaps_.empty() ? Timestamp(-1) : submaps_.back().frames.back().time;
  }
  Timestamp TimeOf(size_t index) const { return RenderedImages()[index].time; }
  // The run went through without losing track, but for `skipped` frames.
  void ExpectOneChain(int64_t skipped) {
    EXPECT_THAT(status_, IsOk());
    EXPECT_EQ(summary_.lost, 0);
    EXPECT_EQ(summary_.skipped_frames, skipped);
    EXPECT_EQ(summary_.tracked_frames, summary_.frames);
    EXPECT_EQ(BrokenLinks(), 0);
    EXPECT_FALSE(submaps_.empty());
  }
  // The run ended with this error, and all before the frame is in the outbox.
  void ExpectClosedBefore(size_t index) {
    EXPECT_EQ(summary_.frames, static_cast<int64_t>(index));
    EXPECT_EQ(summary_.lost, 0);
    EXPECT_EQ(LastRecorded(), TimeOf(index - 1));
    EXPECT_TRUE(std::filesystem::exists(std::filesystem::path(folder_ / "output/odometry.tum")));
  }

  const TempDir folder_;
  std::vector<ScriptedImage> images_;
  std::vector<ImuSample> imu_;
  ImageSourceInfo info_;
  ImageSourceOptions source_options_;
  std::vector<std::string> log_;
  Status status_;
  RunSummary summary_;
  std::vector<Submap> submaps_;
};

TEST_F(DamagedInputTest, SoundImagesGiveOneChainAndNoWarning) {
  EXPECT_THAT(Run(), IsOk());
  ExpectOneChain(0);
  EXPECT_EQ(LastRecorded(), images_.back().time);
  EXPECT_THAT(log_, IsEmpty());
}

TEST_F(DamagedInputTest, ACameraThatIsUnpluggedEndsTheRunWithTheSubmapClosed) {
  images_.resize(60);
  images_.push_back({TimeOf(60), absl::UnavailableError("camera device 0: unplugged?")});
  EXPECT_THAT(Run(), StatusIs(absl::StatusCode::kUnavailable, HasSubstr("unplugged")));
  ExpectClosedBefore(60);
}

TEST_F(DamagedInputTest, ACameraThatIsUnpluggedWithinTheFirstFramesLeavesNothingBehind) {
  images_.resize(1);
  images_.push_back({TimeOf(1), absl::UnavailableError("camera device 0: unplugged?")});
  EXPECT_THAT(Run(), StatusIs(absl::StatusCode::kUnavailable, HasSubstr("unplugged")));
  EXPECT_THAT(submaps_, IsEmpty());
}

TEST_F(DamagedInputTest, DamagedImagesMayBeSkippedUpToALimit) {
  for (const size_t i : {20, 21, 50}) images_[i].gray = absl::DataLossError("image is truncated");
  source_options_.max_unreadable = 3;
  EXPECT_THAT(Run(), IsOk());
  ExpectOneChain(3);
  EXPECT_THAT(log_, Contains(HasSubstr("truncated")));
  EXPECT_EQ(LastRecorded(), images_.back().time);
}

TEST_F(DamagedInputTest, OneDamagedImageTooManyEndsTheRunWithTheSubmapClosed) {
  for (const size_t i : {20, 50}) images_[i].gray = absl::DataLossError("image is truncated");
  source_options_.max_unreadable = 1;
  EXPECT_THAT(Run(), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("truncated")));
  EXPECT_EQ(LastRecorded(), TimeOf(49));
}

TEST_F(DamagedInputTest, ACalibrationForAnotherSizeEndsTheRunAtTheFirstImage) {
  info_.calibration.intrinsics.width_px = 640;
  info_.calibration.intrinsics.height_px = 480;
  EXPECT_THAT(
      Run(), StatusIs(absl::StatusCode::kInvalidArgument,
                      AllOf(HasSubstr("image 0"), HasSubstr("640 x 480"), HasSubstr("376 x 240"))));
  EXPECT_EQ(summary_.frames, 0);
  EXPECT_THAT(submaps_, IsEmpty());
}

TEST_F(DamagedInputTest, AnImageOfAnotherSizeEndsTheRunWithTheSubmapClosed) {
  images_[55].gray = cv::Mat(480, 640, CV_8UC1, cv::Scalar(7));
  EXPECT_THAT(Run(), StatusIs(absl::StatusCode::kInvalidArgument,
                              AllOf(HasSubstr("image 55"), HasSubstr("640 x 480"))));
  ExpectClosedBefore(55);
}

TEST_F(DamagedInputTest, ACalibrationThatIsNoneIsRefusedAtTheStart) {
  RunnerOptions options;
  options.server = "none";
  options.outbox = folder_ / "outbox";
  info_.calibration.intrinsics.fx_px = std::numeric_limits<double>::quiet_NaN();
  auto source = std::make_unique<PlaybackSource>(source_options_, info_,
                                                 std::make_unique<ScriptedStream>(images_), imu_,
                                                 std::vector<OdometrySample>());
  EXPECT_THAT(AgentRunner::Create(options, AgentOptions(), UplinkOptions(), OutboxOptions(),
                                  std::move(source)),
              StatusIs(absl::StatusCode::kInvalidArgument));
}

TEST_F(DamagedInputTest, SwappedFramesAreSkipped) {
  std::swap(images_[30], images_[31]);
  std::swap(images_[70], images_[71]);
  EXPECT_THAT(Run(), IsOk());
  ExpectOneChain(2);
  EXPECT_THAT(log_, Contains(AllOf(HasSubstr("image 30"), HasSubstr("skipped"))));
}

TEST_F(DamagedInputTest, RepeatedFramesAreSkipped) {
  for (const size_t i : {80, 60, 40, 20}) {
    images_.insert(images_.begin() + static_cast<std::ptrdiff_t>(i), 3, images_[i]);
  }
  EXPECT_THAT(Run(), IsOk());
  ExpectOneChain(12);
  EXPECT_EQ(summary_.frames, static_cast<int64_t>(RenderedImages().size()));
}

TEST_F(DamagedInputTest, OneTimeFarAheadCostsOneFrame) {
  images_[40].time += std::chrono::hours(24);
  EXPECT_THAT(Run(), IsOk());
  ExpectOneChain(1);
  EXPECT_THAT(log_, Contains(AllOf(HasSubstr("image 40"), HasSubstr("skipped"))));
  EXPECT_EQ(LastRecorded(), images_.back().time);
}

TEST_F(DamagedInputTest, AClockThatIsSetBackEndsTheRunWithTheSubmapClosed) {
  for (size_t i = 60; i < images_.size(); ++i) images_[i].time -= std::chrono::seconds(3);
  source_options_.max_out_of_order = 10;
  EXPECT_THAT(Run(),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("clock has gone back")));
  ExpectClosedBefore(60);
}

TEST_F(DamagedInputTest, TimesBeforeTheEpochNeverReachASubmap) {
  const Duration shift = images_[20].time;
  for (ScriptedImage& image : images_) image.time -= shift;
  EXPECT_THAT(Run(), IsOk());
  ExpectOneChain(20);
  EXPECT_EQ(submaps_[0].frames[0].time, Timestamp::zero());
  EXPECT_THAT(log_, Contains(HasSubstr("not that of a clock")));
}

TEST_F(DamagedInputTest, APictureThatFreezesIsNoMotion) {
  for (size_t i = 45; i < 75; ++i) images_[i].gray = RenderedImages()[44].gray;
  images_.resize(75);
  EXPECT_THAT(Run(), IsOk());
  ExpectOneChain(0);
  const auto& frames = submaps_.back().frames;
  ASSERT_GT(frames.size(), 20u);
  const auto travelled = [&](size_t from, size_t to) {
    return (frames[to].submap_from_camera.translation - frames[from].submap_from_camera.translation)
        .norm();
  };
  EXPECT_LT(travelled(frames.size() - 10, frames.size() - 1), 0.01);
}

TEST_F(DamagedInputTest, ALongPauseClosesTheSubmapAndTheMapGoesOn) {
  for (size_t i = 50; i < images_.size(); ++i) images_[i].time += std::chrono::seconds(10);
  EXPECT_THAT(Run(), IsOk());
  EXPECT_EQ(summary_.lost, 1);
  EXPECT_EQ(BrokenLinks(), 1);
  EXPECT_EQ(LastRecorded(), images_.back().time);
  const auto broken = std::find_if(submaps_.begin(), submaps_.end(), [](const Submap& submap) {
    return submap.link == LinkType::kBroken;
  });
  ASSERT_NE(broken, submaps_.begin());
  ASSERT_NE(broken, submaps_.end());
  EXPECT_EQ((broken - 1)->frames.back().time, images_[49].time);
  EXPECT_EQ(broken->frames.front().time, images_[50].time);
}

TEST_F(DamagedInputTest, DroppedFramesAreBridged) {
  std::vector<ScriptedImage> kept;
  for (size_t i = 0; i < images_.size(); ++i) {
    // Every fourth, and once four in a row.
    if (i % 4 == 1 || (i >= 60 && i < 64)) continue;
    kept.push_back(images_[i]);
  }
  images_ = std::move(kept);
  EXPECT_THAT(Run(), IsOk());
  ExpectOneChain(0);
  EXPECT_EQ(LastRecorded(), images_.back().time);
}

TEST_F(DamagedInputTest, NothingButNoiseEndsInOrder) {
  cv::theRNG().state = 3;
  for (ScriptedImage& image : images_) {
    cv::Mat noise(240, 376, CV_8UC1);
    cv::randu(noise, 0, 255);
    image.gray = noise;
  }
  EXPECT_THAT(Run(), IsOk());
  EXPECT_EQ(summary_.frames, static_cast<int64_t>(images_.size()));
  // Nothing can be tracked; what was begun is given up within a few frames.
  for (const Submap& submap : submaps_) EXPECT_LT(submap.frames.size(), 20u);
}

// An IMU whose samples are `damage`d, at 200 Hz.
class DamagedImuTest : public DamagedInputTest {
 protected:
  DamagedImuTest() {
    info_.calibration.body_from_camera = Rigid3::Identity();
    info_.imu_calibration = ImuCalibration{200, 1e-3, 1e-5, 1e-2, 1e-4, {}};
    for (Timestamp time = images_.front().time - std::chrono::milliseconds(100);
         time < images_.back().time; time += std::chrono::milliseconds(5)) {
      imu_.push_back({time, Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(0, -9.81, 0)});
    }
  }
};

TEST_F(DamagedImuTest, SamplesThatAreNoNumbersAreLeftOutAndTheCameraGoesOn) {
  for (ImuSample& sample : imu_) {
    sample.gyro_rad_s.setConstant(std::numeric_limits<double>::quiet_NaN());
  }
  EXPECT_THAT(Run(), IsOk());
  ExpectOneChain(0);
  EXPECT_THAT(log_, Contains(HasSubstr("not a number")));
  for (const Submap& submap : submaps_) EXPECT_FALSE(submap.metric);
}

// That they are not used is tested with the agent (agent_sensors_test.cc).
TEST_F(DamagedImuTest, SamplesOfAnotherClockDoNotDisturbTheCamera) {
  for (ImuSample& sample : imu_) sample.time -= std::chrono::hours(1000);
  EXPECT_THAT(Run(), IsOk());
  ExpectOneChain(0);
}

TEST_F(DamagedImuTest, ACameraOfUnknownPlaceOnTheVehicleIsRefusedAtTheStart) {
  info_.calibration.body_from_camera.reset();
  RunnerOptions options;
  options.server = "none";
  options.outbox = folder_ / "outbox";
  auto source = std::make_unique<PlaybackSource>(source_options_, info_,
                                                 std::make_unique<ScriptedStream>(images_), imu_,
                                                 std::vector<OdometrySample>());
  EXPECT_THAT(AgentRunner::Create(options, AgentOptions(), UplinkOptions(), OutboxOptions(),
                                  std::move(source)),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("T_BS")));
}

}  // namespace
}  // namespace portolan
