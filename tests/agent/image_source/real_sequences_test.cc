// Every real sequence opens by its content alone and delivers its images.
#include "tests/agent/image_source/test_images.h"
#include "tests/support/data_path.h"
#include "tests/support/matchers.h"

namespace portolan {
namespace {

struct RealSequence {
  const char* path;
  int frames;
};

class RealSequenceTest : public testing::TestWithParam<RealSequence> {};

TEST_P(RealSequenceTest, OpensAndDeliversItsFirstAndLastFrames) {
  PORTOLAN_REAL_DATA_OR_SKIP(path, GetParam().path);
  ImageSourceOptions options;
  options.path = path.string();
  const auto all = OpenOrFail(options);
  ASSERT_TRUE(all);
  EXPECT_EQ(all->info().frame_count, GetParam().frames);

  options.stride = GetParam().frames - 1;
  const auto source = OpenOrFail(options);
  ASSERT_TRUE(source);
  const auto first = source->Next(), last = source->Next();
  ASSERT_THAT(first, IsOk());
  ASSERT_THAT(last, IsOk());
  EXPECT_LT((*first)->time, (*last)->time);
  EXPECT_EQ((*last)->index, GetParam().frames - 1);
  EXPECT_FALSE(source->Next()->has_value());
  EXPECT_EQ(source->counts().out_of_order, 0);
}

INSTANTIATE_TEST_SUITE_P(Data, RealSequenceTest,
                         testing::Values(RealSequence{"7scenes/redkitchen_seq-01", 910},
                                         RealSequence{"euroc/MH_01_easy_first18s", 360},
                                         RealSequence{"euroc/V1_01_easy_keyframes", 100},
                                         RealSequence{"kitti/odometry_00_first200", 200},
                                         RealSequence{"monoslam_davison/scenelib_test_sequence",
                                                      1000},
                                         RealSequence{"openekf/desk_translation", 359},
                                         RealSequence{"uzh_vamr/checkerboard_desk", 736}));

TEST(RealImu, CoversTheImages) {
  PORTOLAN_REAL_DATA_OR_SKIP(path, "euroc/MH_01_easy_first18s");
  ImageSourceOptions options;
  options.path = path.string();
  options.imu = true;
  options.end = FrameLimit::Index(20);
  const auto source = OpenOrFail(options);
  ASSERT_TRUE(source);
  ASSERT_GT(source->TakeImu((*source->Next())->time).size(), 300u);
  while (const auto frame = *source->Next()) {
    const auto samples = source->TakeImu(frame->time);
    EXPECT_NEAR(samples.size(), 10, 1);
    for (const ImuSample& sample : samples) EXPECT_NEAR(sample.accel_m_s2.norm(), 9.8, 8);
  }
}

}  // namespace
}  // namespace portolan
