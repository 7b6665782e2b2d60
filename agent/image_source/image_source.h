// One interface for every kind of image sequence and camera.
#ifndef PORTOLAN_AGENT_IMAGE_SOURCE_IMAGE_SOURCE_H_
#define PORTOLAN_AGENT_IMAGE_SOURCE_IMAGE_SOURCE_H_

#include <cstdint>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <vector>

#include "agent/image_source/image_source_options.h"
#include "agent/image_source/samples.h"
#include "common/base/status.h"
#include "common/base/time.h"
#include "common/camera/calibration.h"
#include "common/submap/submap.h"

namespace portolan {

struct Frame {
  Timestamp time{};
  cv::Mat gray;       // CV_8UC1 of the calibration's size
  cv::Mat right;      // the second camera's, likewise; empty if there is none
  std::string name;   // of the file or "frame 17", for messages
  int64_t index = 0;  // in the sequence, from 0, whatever was skipped
};

// What is known before the first image.
struct ImageSourceInfo {
  ImageSourceType type = ImageSourceType::kAuto;
  std::string description;
  // Frames in the chosen range; 0 if unknown.
  int64_t frame_count = 0;
  CameraCalibration calibration;
  std::optional<CameraCalibration> right_calibration;
  std::optional<ImuCalibration> imu_calibration;
  // A file of wheel odometry was given.
  bool has_odometry = false;
  // Satellite positions are delivered, of an antenna there.
  bool has_gnss = false;
  Eigen::Vector3d antenna_in_camera_m = Eigen::Vector3d::Zero();
  // Laser ranges are delivered.
  std::optional<RangeFinder> range_finder;
};

struct ImageSourceCounts {
  int64_t delivered = 0;
  int64_t unreadable = 0;    // missing or damaged, skipped
  int64_t out_of_order = 0;  // time not after the frame before, skipped
  int64_t dropped = 0;       // came too fast (real time only)
};

// A sequence of frames with strictly increasing times. Thread-compatible: one thread asks.
class ImageSource {
 public:
  virtual ~ImageSource() = default;

  // The next frame; no value at the end. An error names the file: NotFound or DataLoss for an
  // image (asking again goes on with the next one), InvalidArgument for an image that is not of
  // the calibration's size, FailedPrecondition for a clock that was set back, Unavailable for a
  // device that went away. Blocks in real-time mode.
  virtual StatusOr<std::optional<Frame>> Next() = 0;

  const ImageSourceInfo& info() const { return info_; }
  const CameraCalibration& calibration() const { return info_.calibration; }
  const ImageSourceCounts& counts() const { return counts_; }

  // All samples up to the given time that were not taken before, in order of time, on the camera's
  // clock (the calibration's time offset is already taken off). Those that lie more than two
  // seconds before the first frame of the range are left out.
  std::vector<ImuSample> TakeImu(Timestamp up_to);
  std::vector<OdometrySample> TakeOdometry(Timestamp up_to);
  std::vector<GnssFix> TakeGnss(Timestamp up_to);
  std::vector<RangeSample> TakeRanges(Timestamp up_to);

 protected:
  ImageSourceInfo info_;
  ImageSourceCounts counts_;
  std::vector<ImuSample> imu_;
  std::vector<OdometrySample> odometry_;
  std::vector<GnssFix> gnss_;
  std::vector<RangeSample> ranges_;

 private:
  size_t imu_taken_ = 0;
  size_t odometry_taken_ = 0;
  size_t gnss_taken_ = 0;
  size_t ranges_taken_ = 0;
};

// Opens what options.path names. Errors: NotFound, InvalidArgument (options, calibration, lists of
// images), naming the file.
StatusOr<std::unique_ptr<ImageSource>> OpenImageSource(const ImageSourceOptions& options);

}  // namespace portolan

#endif  // PORTOLAN_AGENT_IMAGE_SOURCE_IMAGE_SOURCE_H_
