// Where an agent's images come from and which of them are taken.
#ifndef PORTOLAN_AGENT_IMAGE_SOURCE_IMAGE_SOURCE_OPTIONS_H_
#define PORTOLAN_AGENT_IMAGE_SOURCE_IMAGE_SOURCE_OPTIONS_H_

#include <chrono>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/time.h"
#include "common/config/option_table.h"

namespace portolan {

enum class ImageSourceType { kAuto, kEuroc, kTum, kKitti, kFolder, kVideo, kDevice };

// A frame of a sequence, by its number from 0 ("303") or by the time since the first ("12.5s").
struct FrameLimit {
  bool is_time = false;
  int64_t index = 0;       // unless is_time
  Duration since_start{};  // if is_time

  static FrameLimit Index(int64_t index) { return {false, index, {}}; }
  static FrameLimit Time(Duration since_start) { return {true, 0, since_start}; }
};
Status ParseOptionText(const std::string& text, FrameLimit* value);
std::string OptionTextOf(const FrameLimit& value);

// The wall clock of real-time playback; tests put their own in.
struct PlaybackClock {
  using Time = std::chrono::steady_clock::time_point;
  std::function<Time()> now;
  std::function<void(Time)> sleep_until;

  static PlaybackClock Steady();
};

struct ImageSourceOptions {
  // Folder or file of the sequence; /dev/videoN or N for a camera device.
  std::string path;
  // By content, unless the content is ambiguous.
  ImageSourceType type = ImageSourceType::kAuto;
  // Calibration file (EuRoC, plain, OpenCV/ROS, Kalibr); empty: the one that lies in the sequence.
  std::string calibration;
  // Which camera of a rig: camN of EuRoC and Kalibr, image_N of KITTI.
  int camera = 0;
  // Also delivers the second camera's image (EuRoC cam1, KITTI image_1 or image_3).
  bool stereo = false;
  // Also reads the IMU file of the sequence; off, since a purely visual run need not fail for a
  // damaged one.
  bool imu = false;
  // Wheel odometry CSV; empty: none.
  std::string odometry;
  // Folder of a laser range finder's data.csv and sensor.yaml; empty: none.
  std::string range;
  // CSV of satellite positions; empty: gnss.csv of the sequence's folder, if there is one; "none".
  std::string gnss;
  // Where the receiver's antenna is: x, y, z in the camera frame [m].
  std::vector<double> gnss_antenna_in_camera_m = {0, 0, 0};
  // Sequence of a KITTI root that holds several, such as "00".
  std::string kitti_sequence;
  // Rate of images without times [Hz]; 0: the calibration's rate, for video the file's.
  double frame_rate_hz = 0;

  std::optional<FrameLimit> start;
  std::optional<FrameLimit> end;  // included
  // Takes every n-th frame.
  int stride = 1;
  // 0: as fast as frames are asked for, none is dropped. Otherwise the multiple of real time; a
  // frame whose successor is already due is dropped, so that the work never lags.
  double rate = 0;
  // Unreadable or missing images that are skipped before one ends the run: a few damaged files of
  // a recording cost less than the run; 0 is strict.
  int max_unreadable = 0;
  // Frames in a row that are skipped because their times are not after that of the last one used,
  // before the run ends: a few swapped or repeated frames are survived, a clock that was set back
  // is not.
  int max_out_of_order = 50;

  PlaybackClock clock = PlaybackClock::Steady();

  Status Validate() const;
};

// Registers all options but the clock, under their own names, with aliases start, end, stride and
// rate of the command line.
void AddImageSourceOptions(OptionTable* table, ImageSourceOptions* options);

}  // namespace portolan

#endif  // PORTOLAN_AGENT_IMAGE_SOURCE_IMAGE_SOURCE_OPTIONS_H_
