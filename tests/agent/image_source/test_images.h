// Small images and calibrations for the tests of image sources.
#ifndef PORTOLAN_TESTS_AGENT_IMAGE_SOURCE_TEST_IMAGES_H_
#define PORTOLAN_TESTS_AGENT_IMAGE_SOURCE_TEST_IMAGES_H_

#include <filesystem>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "agent/image_source/image_source.h"
#include "tests/support/temp_dir.h"

namespace portolan {

constexpr int kTestWidth = 32, kTestHeight = 24;

// A plain.yaml of a pinhole camera of the test size, at 10 Hz.
std::string TestCalibrationText();
std::string TestSensorYaml();  // the same, EuRoC

// All pixels have this value.
cv::Mat FlatImage(int value, int width = kTestWidth, int height = kTestHeight);
void WriteImage(const std::filesystem::path& path, const cv::Mat& image);
// A folder of `count` images of values 0, 1, 2, ... at 10 Hz from 100 s on with times.txt and
// calib.yaml.
void WriteTestFolder(const TempDir& dir, int count);

// Values of the frames' first pixels until the end; fails the test on an error.
std::vector<int> PixelValues(ImageSource& source);
// Opens or fails the test (then null).
std::unique_ptr<ImageSource> OpenOrFail(const ImageSourceOptions& options);

}  // namespace portolan

#endif  // PORTOLAN_TESTS_AGENT_IMAGE_SOURCE_TEST_IMAGES_H_
