#include "tests/agent/image_source/test_images.h"

#include <opencv2/imgcodecs.hpp>

#include "common/base/concat.h"
#include "tests/support/matchers.h"

namespace portolan {

std::string TestCalibrationText() {
  return "width: 32\nheight: 24\ncamera_model: pinhole\nintrinsics: [30, 30, 16, 12]\n"
         "distortion_model: none\ndistortion_coeffs: []\nrate_hz: 10\n";
}

std::string TestSensorYaml() {
  return "sensor_type: camera\nresolution: [32, 24]\nrate_hz: 10\ncamera_model: pinhole\n"
         "intrinsics: [30, 30, 16, 12]\ndistortion_model: radial-tangential\n"
         "distortion_coefficients: [0, 0, 0, 0]\n"
         "T_BS: {rows: 4, cols: 4, data: [1,0,0,0.1, 0,1,0,0, 0,0,1,0, 0,0,0,1]}\n";
}

cv::Mat FlatImage(int value, int width, int height) {
  return cv::Mat(height, width, CV_8UC1, cv::Scalar(value));
}

void WriteImage(const std::filesystem::path& path, const cv::Mat& image) {
  std::filesystem::create_directories(path.parent_path());
  ASSERT_TRUE(cv::imwrite(path.string(), image)) << path;
}

void WriteTestFolder(const TempDir& dir, int count) {
  std::string times = "# timestamp[s] filename\n";
  for (int i = 0; i < count; ++i) {
    const std::string name = Concat("images/", i, ".png");
    WriteImage(dir / name, FlatImage(i));
    times += Concat(100 + i / 10, ".", i % 10, " ", name, "\n");
  }
  dir.Write("times.txt", times);
  dir.Write("calib.yaml", TestCalibrationText());
}

std::vector<int> PixelValues(ImageSource& source) {
  std::vector<int> values;
  while (true) {
    const auto frame = source.Next();
    EXPECT_THAT(frame, IsOk());
    if (!frame.ok() || !frame->has_value()) return values;
    EXPECT_EQ((*frame)->gray.type(), CV_8UC1);
    values.push_back((*frame)->gray.at<uchar>(0, 0));
  }
}

std::unique_ptr<ImageSource> OpenOrFail(const ImageSourceOptions& options) {
  auto source = OpenImageSource(options);
  EXPECT_THAT(source, IsOk());
  return source.ok() ? std::move(*source) : nullptr;
}

}  // namespace portolan
