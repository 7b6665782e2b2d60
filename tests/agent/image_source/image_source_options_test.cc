#include "agent/image_source/image_source_options.h"

#include "tests/support/matchers.h"

namespace portolan {
namespace {

using absl::StatusCode;
using testing::HasSubstr;

TEST(FrameLimit, IsANumberOrSeconds) {
  FrameLimit limit;
  ASSERT_THAT(ParseOptionText("303", &limit), IsOk());
  EXPECT_FALSE(limit.is_time);
  EXPECT_EQ(limit.index, 303);
  EXPECT_EQ(OptionTextOf(limit), "303");
  ASSERT_THAT(ParseOptionText("12.5s", &limit), IsOk());
  EXPECT_TRUE(limit.is_time);
  EXPECT_EQ(limit.since_start, Duration(12500000000));
  EXPECT_EQ(OptionTextOf(limit), "12.5s");
}

TEST(FrameLimit, RefusesNegativeAndOtherText) {
  FrameLimit limit;
  for (const char* text : {"", "-1", "-2s", "s", "1.5", "ten"}) {
    EXPECT_FALSE(ParseOptionText(text, &limit).ok()) << text;
  }
}

TEST(ImageSourceOptions, CommandLineSetsThem) {
  ImageSourceOptions options;
  OptionTable table;
  AddImageSourceOptions(&table, &options);
  const char* words[] = {
      "agent",          "--start", "10",  "--end=20s",    "--stride",      "2",
      "--source=euroc", "--rate",  "1.5", "--source.imu", "--source.path", "/data",
      "--calibration",  "c.yaml"};
  ASSERT_THAT(table.ParseCommandLine(std::size(words), words), IsOk());
  EXPECT_EQ(options.start->index, 10);
  EXPECT_EQ(options.end->since_start, FromSeconds(20));
  EXPECT_EQ(options.stride, 2);
  EXPECT_EQ(options.type, ImageSourceType::kEuroc);
  EXPECT_EQ(options.rate, 1.5);
  EXPECT_TRUE(options.imu);
  EXPECT_EQ(options.calibration, "c.yaml");
  EXPECT_THAT(options.Validate(), IsOk());
}

TEST(ImageSourceOptions, ValidateNamesTheOption) {
  const auto expect_error = [](void (*spoil)(ImageSourceOptions*), const char* word) {
    ImageSourceOptions options;
    options.path = "x";
    ASSERT_THAT(options.Validate(), IsOk());
    spoil(&options);
    EXPECT_THAT(options.Validate(), StatusIs(StatusCode::kInvalidArgument, HasSubstr(word)));
  };
  expect_error([](ImageSourceOptions* o) { o->path = ""; }, "path");
  expect_error([](ImageSourceOptions* o) { o->camera = -1; }, "camera");
  expect_error([](ImageSourceOptions* o) { o->stride = 0; }, "stride");
  expect_error([](ImageSourceOptions* o) { o->rate = -1; }, "rate");
  expect_error([](ImageSourceOptions* o) { o->max_out_of_order = -1; }, "max_out_of_order");
  expect_error([](ImageSourceOptions* o) { o->frame_rate_hz = -1; }, "frame_rate_hz");
  expect_error([](ImageSourceOptions* o) { o->max_unreadable = -1; }, "max_unreadable");
  expect_error(
      [](ImageSourceOptions* o) {
        o->start = FrameLimit::Index(5);
        o->end = FrameLimit::Index(4);
      },
      "end");
}

}  // namespace
}  // namespace portolan
