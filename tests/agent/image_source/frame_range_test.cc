#include "agent/image_source/frame_range.h"

#include "tests/support/matchers.h"

namespace portolan {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

// Indices taken of 12 frames at 10 Hz that start at 50 s.
std::vector<int> Taken(const ImageSourceOptions& options) {
  FrameRange range(options);
  std::vector<int> taken;
  for (int i = 0; i < 12; ++i) {
    const FrameRange::Place place = range.PlaceOf(i, FromSeconds(50) + i * FromSeconds(0.1));
    if (place == FrameRange::Place::kBeyond) break;
    if (place == FrameRange::Place::kTaken) taken.push_back(i);
  }
  return taken;
}

TEST(FrameRange, TakesAllWithoutLimits) { EXPECT_EQ(Taken({}).size(), 12u); }

TEST(FrameRange, EndIsIncluded) {
  ImageSourceOptions options;
  options.start = FrameLimit::Index(3);
  options.end = FrameLimit::Index(5);
  EXPECT_THAT(Taken(options), ElementsAre(3, 4, 5));
  options.end = FrameLimit::Index(3);
  EXPECT_THAT(Taken(options), ElementsAre(3));
}

TEST(FrameRange, TimesCountFromTheFirstFrame) {
  ImageSourceOptions options;
  options.start = FrameLimit::Time(FromSeconds(0.25));
  options.end = FrameLimit::Time(FromSeconds(0.5));
  EXPECT_THAT(Taken(options), ElementsAre(3, 4, 5));
}

TEST(FrameRange, StrideCountsFromTheFirstTaken) {
  ImageSourceOptions options;
  options.start = FrameLimit::Index(1);
  options.end = FrameLimit::Time(FromSeconds(0.9));
  options.stride = 4;
  EXPECT_THAT(Taken(options), ElementsAre(1, 5, 9));
}

TEST(FrameRange, RangeBeyondTheSequenceIsEmpty) {
  ImageSourceOptions options;
  options.start = FrameLimit::Index(100);
  EXPECT_THAT(Taken(options), IsEmpty());
}

}  // namespace
}  // namespace portolan
