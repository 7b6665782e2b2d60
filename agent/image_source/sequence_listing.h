// Recorded sequences: which image files at which times, with what else lies beside them.
#ifndef PORTOLAN_AGENT_IMAGE_SOURCE_SEQUENCE_LISTING_H_
#define PORTOLAN_AGENT_IMAGE_SOURCE_SEQUENCE_LISTING_H_

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "agent/image_source/image_source_options.h"
#include "agent/image_source/samples.h"
#include "common/base/status.h"
#include "common/camera/calibration.h"

namespace portolan {

struct ListedFrame {
  Timestamp time{};
  std::filesystem::path image;
  std::filesystem::path right;  // empty if there is none
};

// In the order of the file's lines, unchecked.
struct SequenceListing {
  std::vector<ListedFrame> frames;
  CameraCalibration calibration;
  std::optional<CameraCalibration> right_calibration;
  std::optional<ImuCalibration> imu_calibration;
  std::vector<ImuSample> imu;
};

// EuRoC/ASL: PATH/mav0/camN/{data.csv, sensor.yaml, data/}, or PATH itself mav0.
bool IsEurocFolder(const std::filesystem::path& path);
StatusOr<SequenceListing> ListEuroc(const ImageSourceOptions& options);

// TUM RGB-D: PATH/rgb.txt. Without a calibration file the published ones of the folders named
// freiburg1, 2 and 3 are taken.
bool IsTumFolder(const std::filesystem::path& path);
StatusOr<SequenceListing> ListTum(const ImageSourceOptions& options);

// KITTI odometry: PATH/{image_0, times.txt, calib.txt}, or the root with sequences/NN.
bool IsKittiFolder(const std::filesystem::path& path);
StatusOr<SequenceListing> ListKitti(const ImageSourceOptions& options);

// A folder with a list of images (data.csv: "ns,file"; times.txt: "seconds file"), or such a list
// itself, or just images whose names sort by time. Images lie beside the list or in its folder
// images, data or rgb. imu0.csv and imu0.yaml beside it are the IMU's.
StatusOr<SequenceListing> ListFolder(const ImageSourceOptions& options);

// Shared by the layouts.
bool FileExists(const std::filesystem::path& path);
// options.calibration if given, else the first of the candidates that exists; NotFound names
// them. `camera` picks one of a file that holds several.
StatusOr<CameraCalibration> FindCalibration(const ImageSourceOptions& options, int camera,
                                            const std::vector<std::filesystem::path>& candidates);
// A list of times and names. Whole numbers are nanoseconds in a CSV or when too large for seconds;
// all else is seconds. Names are made paths by trying `folders` in turn on
// the first of them.
StatusOr<std::vector<ListedFrame>> ReadFrameList(const std::filesystem::path& path,
                                                 const std::vector<std::filesystem::path>& folders);
// The image files of a folder, sorted by name.
std::vector<std::filesystem::path> SortedImages(const std::filesystem::path& folder);
// Reads the IMU files into the listing, on the camera's clock; NotFound if they are missing.
Status ReadImuInto(const std::filesystem::path& csv, const std::filesystem::path& yaml,
                   SequenceListing* listing);

}  // namespace portolan

#endif  // PORTOLAN_AGENT_IMAGE_SOURCE_SEQUENCE_LISTING_H_
