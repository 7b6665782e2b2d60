#include "agent/image_source/image_decoder.h"

#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <sstream>

#include "tests/agent/image_source/test_images.h"
#include "tests/support/matchers.h"

namespace portolan {
namespace {

using absl::StatusCode;
using testing::HasSubstr;

// A detailed image, so that every format needs many bytes for it.
cv::Mat Textured(int channels) {
  cv::Mat image(120, 160, CV_8UC(channels));
  uint32_t state = 1;
  for (int i = 0; i < static_cast<int>(image.total()) * channels; ++i) {
    state = state * 1664525u + 1013904223u;
    image.data[i] = state >> 24;
  }
  return image;
}

std::string ReadAll(const std::filesystem::path& path) {
  std::ostringstream text;
  text << std::ifstream(path, std::ios::binary).rdbuf();
  return text.str();
}

class ImageDecoderTest : public testing::TestWithParam<const char*> {
 protected:
  TempDir dir_;
  ImageDecoder decoder_;
};

TEST_P(ImageDecoderTest, ReadsGreyAndColourAsGrey) {
  for (const int channels : {1, 3}) {
    if (channels == 3 && GetParam() == std::string(".pgm")) continue;  // cannot hold colour
    const auto path = dir_ / Concat("image", channels, GetParam());
    WriteImage(path, Textured(channels));
    const auto image = decoder_.DecodeGray(path);
    ASSERT_THAT(image, IsOk());
    EXPECT_EQ(image->type(), CV_8UC1);
    EXPECT_EQ(image->size(), cv::Size(160, 120));
  }
}

TEST_P(ImageDecoderTest, TruncatedFileIsDataLoss) {
  const auto path = dir_ / Concat("image", GetParam());
  WriteImage(path, Textured(1));
  const std::string whole = ReadAll(path);
  for (const double share : {0.02, 0.5, 0.97}) {
    dir_.Write(path.filename().string(), whole.substr(0, share * whole.size()));
    EXPECT_THAT(decoder_.DecodeGray(path),
                StatusIs(StatusCode::kDataLoss, HasSubstr(path.filename().string())))
        << share;
  }
}

INSTANTIATE_TEST_SUITE_P(Formats, ImageDecoderTest, testing::Values(".png", ".jpg", ".pgm"),
                         [](const auto& info) { return std::string(info.param + 1); });

// The pixels of OpenCV's own decoder.
TEST(ImageDecoder, PixelsAreThoseOfOpenCv) {
  const TempDir dir;
  ImageDecoder decoder;
  cv::Mat deep;
  Textured(1).convertTo(deep, CV_16U, 257.0, 3.0);
  cv::Mat deep_colour;
  Textured(3).convertTo(deep_colour, CV_16U, 200.0, 77.0);
  const std::vector<std::pair<std::string, cv::Mat>> images = {
      {"grey.png", Textured(1)},        {"colour.png", Textured(3)},
      {"transparent.png", Textured(4)}, {"deep.png", deep},
      {"deep_colour.png", deep_colour}, {"grey.jpg", Textured(1)},
      {"colour.jpg", Textured(3)}};
  for (const auto& [name, image] : images) {
    const auto path = dir / name;
    WriteImage(path, image);
    const auto ours = decoder.DecodeGray(path);
    ASSERT_THAT(ours, IsOk()) << name;
    const cv::Mat theirs =
        cv::imread(path.string(), cv::IMREAD_GRAYSCALE | cv::IMREAD_IGNORE_ORIENTATION);
    EXPECT_EQ(cv::norm(*ours, theirs, cv::NORM_INF), 0) << name;
  }
}

// Every byte of a small file in turn: an image or an error, but no crash.
TEST(ImageDecoder, DamagedBytesAreAnImageOrAnError) {
  const TempDir dir;
  ImageDecoder decoder;
  for (const char* name : {"a.png", "a.jpg"}) {
    WriteImage(dir / name, Textured(1)(cv::Rect(0, 0, 24, 16)).clone());
    const std::string whole = ReadAll(dir / name);
    int errors = 0;
    for (size_t i = 4; i < whole.size(); ++i) {
      std::string damaged = whole;
      damaged[i] = static_cast<char>(damaged[i] ^ 0x55);
      const auto image = decoder.DecodeGray(dir.Write(Concat("damaged", name), damaged));
      if (!image.ok()) {
        EXPECT_THAT(image, StatusIs(StatusCode::kDataLoss, HasSubstr(name)));
        ++errors;
      }
    }
    EXPECT_GT(errors, 10) << name;
  }
}

TEST(ImageDecoder, MissingEmptyAndForeignFilesAreNamed) {
  const TempDir dir;
  ImageDecoder decoder;
  EXPECT_THAT(decoder.DecodeGray(dir / "none.png"),
              StatusIs(StatusCode::kNotFound, HasSubstr("none.png")));
  EXPECT_THAT(decoder.DecodeGray(dir.path()), StatusIs(StatusCode::kNotFound));
  EXPECT_THAT(decoder.DecodeGray(dir.Write("empty.png", "")),
              StatusIs(StatusCode::kDataLoss, HasSubstr("empty.png")));
  EXPECT_THAT(decoder.DecodeGray(dir.Write("text.png", "this is no image")),
              StatusIs(StatusCode::kDataLoss, HasSubstr("text.png")));
}

TEST(ImageDecoder, KnowsImageNames) {
  EXPECT_TRUE(HasImageExtension("a/B.PNG"));
  EXPECT_FALSE(HasImageExtension("times.txt"));
}

}  // namespace
}  // namespace portolan
