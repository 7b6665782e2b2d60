#include <opencv2/videoio.hpp>

#include "agent/image_source/video_stream.h"
#include "tests/agent/image_source/test_images.h"
#include "tests/support/matchers.h"

namespace portolan {
namespace {

using absl::StatusCode;
using testing::HasSubstr;

class VideoTest : public testing::Test {
 protected:
  // Motion JPEG in AVI: OpenCV brings its own writer and reader.
  void WriteVideo(int frames) {
    cv::VideoWriter writer(path_, cv::CAP_OPENCV_MJPEG, cv::VideoWriter::fourcc('M', 'J', 'P', 'G'),
                           20, cv::Size(kTestWidth, kTestHeight));
    ASSERT_TRUE(writer.isOpened());
    for (int i = 0; i < frames; ++i) {
      writer.write(cv::Mat(kTestHeight, kTestWidth, CV_8UC3, cv::Scalar::all(20 * i)));
    }
  }
  TempDir dir_;
  std::string path_ = (dir_ / "clip.avi").string();
};

TEST_F(VideoTest, IsReadWithTheCalibrationBesideIt) {
  WriteVideo(6);
  dir_.Write("clip.yaml", TestCalibrationText());
  ImageSourceOptions options;
  options.path = path_;
  options.start = FrameLimit::Index(1);
  options.end = FrameLimit::Index(4);
  const auto source = OpenOrFail(options);
  ASSERT_TRUE(source);
  EXPECT_EQ(source->info().type, ImageSourceType::kVideo);
  for (int i = 1; i <= 4; ++i) {
    const auto frame = source->Next();
    ASSERT_THAT(frame, IsOk());
    ASSERT_TRUE(frame->has_value());
    EXPECT_EQ((*frame)->time, FromSeconds(i / 20.0));
    EXPECT_NEAR((*frame)->gray.at<uchar>(5, 5), 20 * i, 3);
    EXPECT_EQ((*frame)->name, path_ + " frame " + std::to_string(i));
  }
  EXPECT_FALSE(source->Next()->has_value());
}

TEST_F(VideoTest, FramesKeepTheirOwnPixels) {
  WriteVideo(3);
  const auto stream = VideoStream::Open(path_, 0);
  ASSERT_THAT(stream, IsOk());
  ASSERT_TRUE((*stream)->Advance());
  const cv::Mat first = (*stream)->Decode()->gray;
  ASSERT_TRUE((*stream)->Advance());
  const cv::Mat second = (*stream)->Decode()->gray;
  EXPECT_NEAR(first.at<uchar>(0, 0), 0, 3);
  EXPECT_NEAR(second.at<uchar>(0, 0), 20, 3);
}

TEST_F(VideoTest, MissingOrForeignFileIsNamed) {
  EXPECT_THAT(VideoStream::Open(path_, 0), StatusIs(StatusCode::kNotFound, HasSubstr("clip.avi")));
  dir_.Write("clip.avi", "no video");
  EXPECT_THAT(VideoStream::Open(path_, 0),
              StatusIs(StatusCode::kInvalidArgument, HasSubstr("clip.avi")));
}

TEST(ToGray, TakesOneThreeAndFourChannels) {
  EXPECT_THAT(ToGray(cv::Mat(2, 2, CV_8UC1)), IsOk());
  EXPECT_EQ(ToGray(cv::Mat(2, 2, CV_8UC3, cv::Scalar::all(7)))->at<uchar>(0, 0), 7);
  EXPECT_EQ(ToGray(cv::Mat(2, 2, CV_8UC4, cv::Scalar::all(7)))->at<uchar>(0, 0), 7);
  EXPECT_FALSE(ToGray(cv::Mat(2, 2, CV_16UC1)).ok());
  EXPECT_FALSE(ToGray(cv::Mat(2, 2, CV_8UC2)).ok());
  EXPECT_FALSE(ToGray(cv::Mat()).ok());
}

}  // namespace
}  // namespace portolan
