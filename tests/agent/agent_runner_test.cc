// The runner without a server: what is in the outbox and in the files after disturbed runs.
#include "agent/agent_runner.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <set>

#include "common/trajectory/trajectory_io.h"
#include "common/wire/submap_wire.h"
#include "tests/agent/rendered_sequence.h"
#include "tests/support/matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/synthetic/euroc_writer.h"

namespace portolan {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

constexpr int kFrames = 60;
constexpr int kTruncated = 40;

// Images from memory.
class MemorySource : public ImageSource {
 public:
  explicit MemorySource(std::vector<TimedImage> images) : images_(std::move(images)) {
    info_.calibration.intrinsics = synthetic::MissionOptions::SmallCamera();
  }

  StatusOr<std::optional<Frame>> Next() override {
    if (next_ == images_.size()) return std::optional<Frame>();
    Frame frame;
    frame.time = images_[next_].time;
    frame.gray = images_[next_].gray;
    frame.name = "image";
    frame.index = static_cast<int64_t>(next_++);
    return std::optional<Frame>(std::move(frame));
  }

 private:
  std::vector<TimedImage> images_;
  size_t next_ = 0;
};

class AgentRunnerTest : public ::testing::Test {
 protected:
  static std::unique_ptr<AgentRunner> MakeRunner(const TempDir& folder,
                                                 std::unique_ptr<ImageSource> source) {
    RunnerOptions options;
    options.server = "none";
    options.outbox = folder / "outbox";
    options.output = folder / "output";
    options.progress = false;
    auto runner = AgentRunner::Create(options, AgentOptions(), UplinkOptions(), OutboxOptions(),
                                      std::move(source));
    EXPECT_THAT(runner, IsOk());
    return std::move(*runner);
  }

  // A sequence in which one image's file ends in its middle; the name of that file.
  static std::string WriteTruncatedSequence(const TempDir& folder) {
    const synthetic::Mission mission = RenderedMission(kFrames);
    EXPECT_THAT(WriteEurocAgent(mission, 0, folder.path().string(), {}), IsOk());
    const std::string name = std::to_string(mission.FrameTime(kTruncated).count()) + ".jpg";
    const fs::path file = folder / "agent0/mav0/cam0/data" / name;
    fs::resize_file(file, fs::file_size(file) / 2);
    return name;
  }

  static std::unique_ptr<ImageSource> OpenSequence(const TempDir& folder, int max_unreadable) {
    ImageSourceOptions options;
    options.path = folder / "agent0";
    options.max_unreadable = max_unreadable;
    auto source = OpenImageSource(options);
    EXPECT_THAT(source, IsOk());
    return std::move(*source);
  }

  // Times of all frames of the submaps in the outbox.
  static std::set<Timestamp> OutboxTimes(const TempDir& folder) {
    std::set<Timestamp> times;
    const auto sessions = Outbox::FindPendingSessions(folder / "outbox");
    EXPECT_EQ(sessions.size(), 1u);
    if (sessions.empty()) return times;
    const auto outbox = Outbox::Open(sessions[0], OutboxOptions());
    EXPECT_THAT(outbox, IsOk());
    if (!outbox.ok()) return times;
    for (auto i = (*outbox)->NextPending(0); i; i = (*outbox)->NextPending(*i + 1)) {
      const auto bytes = (*outbox)->Read(*i);
      EXPECT_THAT(bytes, IsOk());
      const auto submap = DecodeSubmap(bytes.value_or(""));
      EXPECT_THAT(submap, IsOk());
      if (!submap.ok()) continue;
      for (const FramePose& frame : submap->frames) times.insert(frame.time);
    }
    return times;
  }
};

std::set<Timestamp> FrameTimes(int begin, int end) {
  std::set<Timestamp> times;
  for (int i = begin; i < end; ++i) times.insert(RenderedImages()[static_cast<size_t>(i)].time);
  return times;
}

TEST_F(AgentRunnerTest, ATruncatedImageEndsTheRunAndWhatCameBeforeIsKept) {
  const TempDir folder;
  const std::string name = WriteTruncatedSequence(folder);
  {
    const auto runner = MakeRunner(folder, OpenSequence(folder, 0));
    EXPECT_THAT(runner->Run(false), StatusIs(absl::StatusCode::kDataLoss, HasSubstr(name)));
    EXPECT_EQ(runner->summary().frames, kTruncated);
    EXPECT_EQ(runner->summary().lost, 0);
    EXPECT_GT(runner->summary().pending_submaps, 0u);
  }
  EXPECT_EQ(OutboxTimes(folder), FrameTimes(0, kTruncated));
  const auto odometry = ReadTumTrajectory(folder / "output/odometry.tum");
  ASSERT_THAT(odometry, IsOk());
  EXPECT_EQ(odometry->size(), static_cast<size_t>(kTruncated));
}

TEST_F(AgentRunnerTest, SkipsATruncatedImageWhereThatIsAllowed) {
  const TempDir folder;
  WriteTruncatedSequence(folder);
  {
    const auto runner = MakeRunner(folder, OpenSequence(folder, 1));
    EXPECT_THAT(runner->Run(false), IsOk());
    EXPECT_EQ(runner->summary().frames, kFrames - 1);
    EXPECT_EQ(runner->summary().tracked_frames, kFrames - 1);
    EXPECT_EQ(runner->summary().skipped_frames, 1);
    EXPECT_EQ(runner->summary().lost, 0);
  }
  std::set<Timestamp> expected = FrameTimes(0, kFrames);
  expected.erase(RenderedImages()[kTruncated].time);
  EXPECT_EQ(OutboxTimes(folder), expected);
}

// Two failures shortly after each other: the submap in between is not uploaded and its number is
// used again. The odometry must not join what has no relation.
TEST_F(AgentRunnerTest, OdometryIsOfOnePieceAfterFailures) {
  std::vector<TimedImage> images = RenderedImages();
  for (const size_t dark : {30, 42}) {
    for (size_t i = dark; i < dark + 10; ++i) images[i].gray = BlackImage();
  }
  const TempDir folder;
  const auto runner = MakeRunner(folder, std::make_unique<MemorySource>(images));
  ASSERT_THAT(runner->Run(false), IsOk());
  EXPECT_EQ(runner->summary().lost, 2);
  const auto odometry = ReadTumTrajectory(folder / "output/odometry.tum");
  ASSERT_THAT(odometry, IsOk());
  ASSERT_EQ(odometry->size(), 48u);
  EXPECT_EQ(odometry->front().time, images[52].time);
  EXPECT_THAT(odometry->front().world_from_body, NearRigid(Rigid3::Identity(), 0));
}

}  // namespace
}  // namespace portolan
