// The agent from image to submap, on rendered images: sound ones, and all that goes wrong.
#include "agent/agent.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <span>

#include "common/wire/submap_wire.h"
#include "tests/agent/rendered_sequence.h"
#include "tests/support/matchers.h"

namespace portolan {
namespace {

using testing::AllOf;
using testing::HasSubstr;

constexpr Duration kFrameTime = std::chrono::milliseconds(50);

std::unique_ptr<Agent> MakeAgent() {
  auto agent = Agent::Create(AgentOptions(), RenderedCamera(), AgentId("tester"), SessionId(7));
  EXPECT_THAT(agent, IsOk());
  return std::move(*agent);
}

// What an agent made of images that it was to accept.
struct AgentRun {
  std::vector<FrameResult> results;  // without the closed submaps
  std::vector<Submap> submaps;

  int tracked() const {
    return static_cast<int>(
        std::count_if(results.begin(), results.end(), [](const auto& r) { return r.tracked; }));
  }
  int broken_links() const {
    return static_cast<int>(std::count_if(
        submaps.begin(), submaps.end(), [](const auto& s) { return s.link == LinkType::kBroken; }));
  }
};

void Feed(Agent* agent, std::span<const TimedImage> images, AgentRun* run) {
  for (const TimedImage& image : images) {
    auto result = agent->ProcessImage(image.time, image.gray);
    ASSERT_THAT(result, IsOk());
    if (result->closed_submap) run->submaps.push_back(*std::move(result->closed_submap));
    result->closed_submap.reset();
    run->results.push_back(*std::move(result));
  }
}

AgentRun RunAgent(std::span<const TimedImage> images) {
  const auto agent = MakeAgent();
  AgentRun run;
  Feed(agent.get(), images, &run);
  if (auto last = agent->Finish()) run.submaps.push_back(*std::move(last));
  return run;
}

std::vector<std::string> Encode(const std::vector<Submap>& submaps) {
  std::vector<std::string> all;
  for (const Submap& submap : submaps) {
    const auto bytes = EncodeSubmap(submap);
    EXPECT_THAT(bytes, IsOk());
    all.push_back(bytes.value_or(""));
  }
  return all;
}

// The undisturbed run that the others are held against.
const AgentRun& UndisturbedRun() {
  static const auto* const run = new AgentRun(RunAgent(RenderedImages()));
  return *run;
}

TEST(Agent, MakesConnectedSubmapsOfEveryFrame) {
  const AgentRun& run = UndisturbedRun();
  EXPECT_EQ(run.tracked(), static_cast<int>(RenderedImages().size()));
  ASSERT_GE(run.submaps.size(), 2u);
  for (size_t i = 0; i < run.submaps.size(); ++i) {
    const Submap& submap = run.submaps[i];
    EXPECT_EQ(submap.key, (SubmapKey{AgentId("tester"), SessionId(7), static_cast<uint32_t>(i)}));
    EXPECT_EQ(submap.link, i == 0 ? LinkType::kNone : LinkType::kConnected);
    EXPECT_THAT(submap.keyframes[0].submap_from_camera, NearRigid(Rigid3::Identity(), 0));
    EXPECT_GT(submap.landmarks.size(), 15u) << i;
    // The next one begins with the image that ends this one.
    const Timestamp begin =
        i == 0 ? RenderedImages()[0].time : run.submaps[i - 1].frames.back().time;
    EXPECT_EQ(submap.frames.front().time, begin);
    EXPECT_EQ(submap.frames.front().time, submap.keyframes.front().time);
    EXPECT_EQ(submap.frames.back().time, submap.keyframes.back().time);
  }
  EXPECT_EQ(run.submaps.back().frames.back().time, RenderedImages().back().time);
}

TEST(Agent, SameImagesGiveTheSameBytes) {
  const auto bytes = Encode(RunAgent(RenderedImages()).submaps);
  EXPECT_TRUE(bytes == Encode(UndisturbedRun().submaps));
}

TEST(Agent, DescribesEverySecondKeyframeForTheSearchOfTheMap) {
  int keyframes = 0;
  for (const FrameResult& result : RunAgent(RenderedImages()).results) {
    if (!result.is_keyframe || !result.tracked) {
      EXPECT_TRUE(result.features.empty());
      continue;
    }
    EXPECT_EQ(result.features.empty(), keyframes++ % 2 == 1);
    for (const Feature& feature : result.features) EXPECT_TRUE(feature.track.has_value());
  }
  EXPECT_GT(keyframes, 10);
}

TEST(Agent, ImagesOfAnotherKindAreRefusedAndLeaveNoTrace) {
  const auto agent = MakeAgent();
  const auto& images = RenderedImages();
  const auto expect_refused = [&](const cv::Mat& image, const auto& message) {
    EXPECT_THAT(agent->ProcessImage(images[40].time, image),
                StatusIs(absl::StatusCode::kInvalidArgument, message));
  };
  AgentRun run;
  Feed(agent.get(), std::span(images).first(40), &run);
  expect_refused(cv::Mat::zeros(240, 320, CV_8UC1),
                 AllOf(HasSubstr("320x240"), HasSubstr("376x240")));
  expect_refused(cv::Mat(), AllOf(HasSubstr("0x0"), HasSubstr("376x240")));
  expect_refused(cv::Mat::zeros(240, 376, CV_8UC3), HasSubstr("grey"));
  expect_refused(cv::Mat::zeros(240, 376, CV_16UC1), HasSubstr("grey"));
  Feed(agent.get(), std::span(images).subspan(40), &run);
  if (auto last = agent->Finish()) run.submaps.push_back(*std::move(last));
  EXPECT_TRUE(Encode(run.submaps) == Encode(UndisturbedRun().submaps));
}

TEST(Agent, TimesThatDoNotAscendAreRefusedAndLeaveNoTrace) {
  const auto agent = MakeAgent();
  const auto& images = RenderedImages();
  AgentRun run;
  Feed(agent.get(), std::span(images).first(40), &run);
  for (const size_t repeated : {39, 38, 0}) {
    EXPECT_THAT(agent->ProcessImage(images[repeated].time, images[repeated].gray),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("not after")));
  }
  Feed(agent.get(), std::span(images).subspan(40), &run);
  if (auto last = agent->Finish()) run.submaps.push_back(*std::move(last));
  EXPECT_TRUE(Encode(run.submaps) == Encode(UndisturbedRun().submaps));
}

TEST(Agent, DarknessEndsTheSubmapBeforeItBegan) {
  constexpr size_t kDarkFrom = 60, kLightFrom = 80;
  // A start may fail once and be tried again.
  constexpr size_t kTrackedFrom = kLightFrom + 10;
  std::vector<TimedImage> images = RenderedImages();
  for (size_t i = kDarkFrom; i < kLightFrom; ++i) images[i].gray = BlackImage();
  const AgentRun run = RunAgent(images);
  ASSERT_EQ(run.results.size(), images.size());
  for (size_t i = 0; i < images.size(); ++i) {
    if (i >= kLightFrom && i < kTrackedFrom) continue;
    EXPECT_EQ(run.results[i].tracked, i < kDarkFrom || i >= kTrackedFrom) << "frame " << i;
  }
  ASSERT_GE(run.submaps.size(), 2u);
  EXPECT_EQ(run.broken_links(), 1);
  for (size_t i = 0; i < run.submaps.size(); ++i) {
    EXPECT_EQ(run.submaps[i].key.sequence_number, i);
    if (run.submaps[i].link != LinkType::kBroken) continue;
    EXPECT_GE(run.submaps[i].frames.front().time, images[kLightFrom].time);
    EXPECT_LT(run.submaps[i].frames.front().time, images[kTrackedFrom].time);
    ASSERT_GT(i, 0u);
    const Submap& before = run.submaps[i - 1];
    EXPECT_EQ(before.frames.back().time, images[kDarkFrom - 1].time);
    EXPECT_LT(before.keyframes.back().time, images[kDarkFrom].time);
  }
  EXPECT_EQ(run.results.back().link, LinkType::kBroken);
  Encode(run.submaps);  // all of them can be uploaded
}

TEST(Agent, DarknessFromTheStartGivesNothing) {
  const auto agent = MakeAgent();
  AgentRun run;
  for (int i = 0; i < 10; ++i) {
    Feed(agent.get(), std::vector<TimedImage>{{i * kFrameTime, BlackImage()}}, &run);
  }
  EXPECT_EQ(run.tracked(), 0);
  EXPECT_TRUE(run.submaps.empty());
  EXPECT_FALSE(agent->Finish());
}

TEST(Agent, FinishWithoutImagesGivesNothing) {
  const auto agent = MakeAgent();
  EXPECT_FALSE(agent->Finish());
  EXPECT_FALSE(agent->Finish());
}

// A submap that fails at once is not uploaded; its number goes to the next one, and the result
// tells that it is another one.
TEST(Agent, ASubmapTooShortForUploadGivesItsNumberToTheNext) {
  std::vector<TimedImage> images = RenderedImages();
  size_t begin = 0;
  while (UndisturbedRun().results[begin].submap_sequence_number == 0) ++begin;
  for (size_t i = begin + 2; i < begin + 12; ++i) images[i].gray = BlackImage();
  const AgentRun run = RunAgent(images);
  ASSERT_GE(run.submaps.size(), 2u);
  EXPECT_EQ(run.submaps[0].frames.back().time, images[begin].time);
  EXPECT_EQ(run.submaps[1].key.sequence_number, 1u);
  EXPECT_EQ(run.submaps[1].link, LinkType::kBroken);
  EXPECT_EQ(run.submaps[1].frames.front().time, images[begin + 12].time);
  for (size_t i = 0; i <= begin + 12; ++i) {
    const bool begins = i == 0 || i == begin || i == begin + 12;
    EXPECT_EQ(run.results[i].begins_submap, begins) << "frame " << i;
  }
}

TEST(Agent, ALongPauseClosesTheSubmap) {
  constexpr size_t kPauseBefore = 50;
  std::vector<TimedImage> images = RenderedImages();
  const Duration pause = FromSeconds(TrackingHealthOptions().max_pause_s);
  for (size_t i = kPauseBefore; i < images.size(); ++i) images[i].time += pause;
  const auto agent = MakeAgent();
  AgentRun run;
  Feed(agent.get(), std::span(images).first(kPauseBefore), &run);
  const size_t closed = run.submaps.size();
  Feed(agent.get(), std::span(images).subspan(kPauseBefore), &run);
  ASSERT_GT(run.submaps.size(), closed);
  EXPECT_EQ(run.submaps[closed].frames.back().time, images[kPauseBefore - 1].time);
  EXPECT_EQ(run.results[kPauseBefore].link, LinkType::kBroken);
  EXPECT_EQ(run.results[kPauseBefore].submap_sequence_number, closed + 1);
  EXPECT_EQ(run.tracked(), static_cast<int>(images.size()));
  EXPECT_TRUE(agent->Finish());
}

TEST(Agent, SurvivesASuddenChangeOfTheExposure) {
  std::vector<TimedImage> images = RenderedImages();
  for (size_t i = 50; i < images.size(); ++i) {
    images[i].gray = images[i].gray.clone();
    images[i].gray.convertTo(images[i].gray, -1, 1.6, 20);
  }
  const AgentRun run = RunAgent(images);
  EXPECT_EQ(run.tracked(), static_cast<int>(images.size()));
  EXPECT_EQ(run.broken_links(), 0);
}

TEST(Agent, SurvivesDroppedFrames) {
  std::vector<TimedImage> images;
  for (size_t i = 0; i < RenderedImages().size(); ++i) {
    if (i % 3 != 2) images.push_back(RenderedImages()[i]);
  }
  const AgentRun run = RunAgent(images);
  EXPECT_EQ(run.tracked(), static_cast<int>(images.size()));
  EXPECT_EQ(run.broken_links(), 0);
}

}  // namespace
}  // namespace portolan
