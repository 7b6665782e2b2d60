#include "agent/image_source/playback_source.h"

#include <fstream>

#include "common/base/logging.h"
#include "tests/agent/image_source/test_images.h"
#include "tests/support/matchers.h"

namespace portolan {
namespace {

using absl::StatusCode;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

// A wall clock that only the test and the sleeps move.
struct FakeClock {
  PlaybackClock::Time now{};
  int sleeps = 0;

  PlaybackClock Clock() {
    return {[this] { return now; },
            [this](PlaybackClock::Time time) {
              ++sleeps;
              now = time;
            }};
  }
  void Advance(double seconds) { now += FromSeconds(seconds); }
};

class PlaybackSourceTest : public testing::Test {
 protected:
  PlaybackSourceTest() {
    SetLogSink([this](LogLevel, std::string_view text) { log_.emplace_back(text); });
    options_.path = dir_.path().string();
  }
  ~PlaybackSourceTest() override { SetLogSink({}); }

  TempDir dir_;
  ImageSourceOptions options_;
  std::vector<std::string> log_;
};

TEST_F(PlaybackSourceTest, RangeAndStrideKeepTheIndices) {
  WriteTestFolder(dir_, 10);
  options_.start = FrameLimit::Index(2);
  options_.end = FrameLimit::Index(8);
  options_.stride = 3;
  const auto source = OpenOrFail(options_);
  ASSERT_TRUE(source);
  EXPECT_EQ(source->info().frame_count, 3);
  EXPECT_EQ((*source->Next())->index, 2);
  EXPECT_EQ((*source->Next())->index, 5);
  EXPECT_EQ((*source->Next())->index, 8);
  EXPECT_FALSE(source->Next()->has_value());
  EXPECT_FALSE(source->Next()->has_value());
  EXPECT_EQ(source->counts().delivered, 3);
}

TEST_F(PlaybackSourceTest, EmptyRangeIsAnErrorAtOnce) {
  WriteTestFolder(dir_, 3);
  options_.start = FrameLimit::Index(3);
  EXPECT_THAT(OpenImageSource(options_),
              StatusIs(StatusCode::kInvalidArgument, HasSubstr("there are 3")));
}

TEST_F(PlaybackSourceTest, RepeatedAndBackwardTimesAreSkippedAndCounted) {
  WriteTestFolder(dir_, 5);
  dir_.Write("times.txt",
             "1.0 images/0.png\n1.2 images/1.png\n1.2 images/2.png\n1.1 images/3.png\n"
             "1.3 images/4.png\n");
  const auto source = OpenOrFail(options_);
  ASSERT_TRUE(source);
  EXPECT_THAT(PixelValues(*source), ElementsAre(0, 1, 4));
  EXPECT_EQ(source->counts().out_of_order, 2);
  EXPECT_THAT(log_, ElementsAre(HasSubstr("2.png"), HasSubstr("3.png")));
}

TEST_F(PlaybackSourceTest, ATimeFarAheadOrBeforeTheEpochCostsOneFrame) {
  WriteTestFolder(dir_, 5);
  dir_.Write("times.txt",
             "1.0 images/0.png\n99999.0 images/1.png\n1.1 images/2.png\n-3.0 images/3.png\n"
             "1.2 images/4.png\n");
  const auto source = OpenOrFail(options_);
  ASSERT_TRUE(source);
  EXPECT_THAT(PixelValues(*source), ElementsAre(0, 2, 4));
  EXPECT_EQ(source->counts().out_of_order, 2);
  EXPECT_THAT(log_, ElementsAre(AllOf(HasSubstr("1.png"), HasSubstr("frame that follows")),
                                AllOf(HasSubstr("3.png"), HasSubstr("not that of a clock"))));
}

TEST_F(PlaybackSourceTest, AClockThatWasSetBackEndsTheStream) {
  WriteTestFolder(dir_, 6);
  dir_.Write("times.txt",
             "5.0 images/0.png\n5.1 images/1.png\n1.0 images/2.png\n1.1 images/3.png\n"
             "1.2 images/4.png\n1.3 images/5.png\n");
  options_.max_out_of_order = 2;
  const auto source = OpenOrFail(options_);
  ASSERT_TRUE(source);
  EXPECT_THAT(source->Next(), IsOk());
  EXPECT_THAT(source->Next(), IsOk());
  EXPECT_THAT(source->Next(),
              StatusIs(StatusCode::kFailedPrecondition,
                       AllOf(HasSubstr("4.png"), HasSubstr("clock"), HasSubstr("1.png"))));
  EXPECT_EQ(source->counts().out_of_order, 3);
}

TEST_F(PlaybackSourceTest, SizeOtherThanTheCalibrationsIsAClearError) {
  WriteTestFolder(dir_, 2);
  WriteImage(dir_ / "images/1.png", FlatImage(1, 16, 12));
  const auto source = OpenOrFail(options_);
  ASSERT_TRUE(source);
  EXPECT_THAT(source->Next(), IsOk());
  EXPECT_THAT(source->Next(),
              StatusIs(StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("1.png"), HasSubstr("16 x 12"), HasSubstr("32 x 24"))));
}

TEST_F(PlaybackSourceTest, DamagedImageIsAnErrorThatNamesItAndTheNextFollows) {
  WriteTestFolder(dir_, 4);
  dir_.Write("images/1.png", "not an image");
  std::filesystem::remove(dir_ / "images/2.png");
  const auto source = OpenOrFail(options_);
  ASSERT_TRUE(source);
  EXPECT_THAT(source->Next(), IsOk());
  EXPECT_THAT(source->Next(), StatusIs(StatusCode::kDataLoss, HasSubstr("1.png")));
  EXPECT_THAT(source->Next(), StatusIs(StatusCode::kNotFound, HasSubstr("2.png")));
  EXPECT_THAT(PixelValues(*source), ElementsAre(3));
}

TEST_F(PlaybackSourceTest, SomeDamagedImagesMayBeSkipped) {
  WriteTestFolder(dir_, 5);
  for (const char* name : {"images/1.png", "images/2.png", "images/4.png"}) {
    dir_.Write(name, "not an image");
  }
  options_.max_unreadable = 2;
  const auto source = OpenOrFail(options_);
  ASSERT_TRUE(source);
  EXPECT_EQ((*source->Next())->index, 0);
  EXPECT_EQ((*source->Next())->index, 3);
  EXPECT_EQ(source->counts().unreadable, 2);
  EXPECT_THAT(source->Next(), StatusIs(StatusCode::kDataLoss, HasSubstr("4.png")));
}

TEST_F(PlaybackSourceTest, AsFastAsItGoesNeverSleepsOrDrops) {
  WriteTestFolder(dir_, 4);
  FakeClock clock;
  options_.clock = clock.Clock();
  const auto source = OpenOrFail(options_);
  ASSERT_TRUE(source);
  while (source->Next()->has_value()) clock.Advance(10);
  EXPECT_EQ(clock.sleeps, 0);
  EXPECT_EQ(source->counts().delivered, 4);
  EXPECT_EQ(source->counts().dropped, 0);
}

TEST_F(PlaybackSourceTest, RealTimeWaitsForEachFrame) {
  WriteTestFolder(dir_, 4);
  FakeClock clock;
  options_.clock = clock.Clock();
  options_.rate = 2;
  const auto source = OpenOrFail(options_);
  ASSERT_TRUE(source);
  EXPECT_THAT(PixelValues(*source), ElementsAre(0, 1, 2, 3));
  EXPECT_EQ(clock.sleeps, 3);
  EXPECT_EQ(clock.now - PlaybackClock::Time{}, FromSeconds(0.15));
}

TEST_F(PlaybackSourceTest, RealTimeDropsFramesWhoseSuccessorIsDue) {
  WriteTestFolder(dir_, 8);
  FakeClock clock;
  options_.clock = clock.Clock();
  options_.rate = 1;
  const auto source = OpenOrFail(options_);
  ASSERT_TRUE(source);
  EXPECT_EQ((*source->Next())->index, 0);
  clock.Advance(0.35);  // frames 1, 2 and 3 are due; only the newest is of use
  EXPECT_EQ((*source->Next())->index, 3);
  EXPECT_EQ(source->counts().dropped, 2);
  EXPECT_EQ((*source->Next())->index, 4);
  clock.Advance(100);  // the last frame of all is always delivered
  EXPECT_EQ((*source->Next())->index, 7);
  EXPECT_EQ(source->counts().dropped, 4);
  EXPECT_FALSE(source->Next()->has_value());
}

TEST_F(PlaybackSourceTest, RealTimeWithStrideComparesWithTheNextFrameOfTheStride) {
  WriteTestFolder(dir_, 9);
  FakeClock clock;
  options_.clock = clock.Clock();
  options_.rate = 1;
  options_.stride = 4;
  const auto source = OpenOrFail(options_);
  ASSERT_TRUE(source);
  EXPECT_EQ((*source->Next())->index, 0);
  clock.Advance(0.7);  // frame 4 is due since 0.3 s, frame 8 is not yet
  EXPECT_EQ((*source->Next())->index, 4);
  EXPECT_EQ((*source->Next())->index, 8);
  EXPECT_EQ(source->counts().dropped, 0);
}

}  // namespace
}  // namespace portolan
