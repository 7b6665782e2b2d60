#include "agent/image_source/image_source_options.h"

#include <algorithm>
#include <cmath>
#include <thread>

namespace portolan {

Status ParseOptionText(const std::string& text, FrameLimit* value) {
  if (!text.empty() && text.back() == 's') {
    Duration since_start{};
    const Status status = ParseOptionText(text.substr(0, text.size() - 1), &since_start);
    if (!status.ok() || since_start < Duration::zero()) {
      return absl::InvalidArgumentError(Concat("expected seconds as '12.5s', not '", text, "'"));
    }
    *value = FrameLimit::Time(since_start);
    return absl::OkStatus();
  }
  int64_t index = 0;
  if (!ParseOptionText(text, &index).ok() || index < 0) {
    return absl::InvalidArgumentError(
        Concat("expected a frame number or seconds as '12.5s', not '", text, "'"));
  }
  *value = FrameLimit::Index(index);
  return absl::OkStatus();
}

std::string OptionTextOf(const FrameLimit& value) {
  return value.is_time ? OptionTextOf(value.since_start) + "s" : OptionTextOf(value.index);
}

PlaybackClock PlaybackClock::Steady() {
  return {[] { return std::chrono::steady_clock::now(); },
          [](Time time) { std::this_thread::sleep_until(time); }};
}

Status ImageSourceOptions::Validate() const {
  if (path.empty()) return absl::InvalidArgumentError("source: no path of images given");
  if (camera < 0 || camera > 99) return absl::InvalidArgumentError("source.camera: not in 0..99");
  if (stride < 1) return absl::InvalidArgumentError("source.stride: must be at least 1");
  if (!(rate >= 0 && rate <= 1000)) {
    return absl::InvalidArgumentError("source.rate: must be in 0..1000");
  }
  if (!(frame_rate_hz >= 0 && frame_rate_hz <= 10000)) {
    return absl::InvalidArgumentError("source.frame_rate_hz: must be in 0..10000");
  }
  if (gnss_antenna_in_camera_m.size() != 3 ||
      std::any_of(gnss_antenna_in_camera_m.begin(), gnss_antenna_in_camera_m.end(),
                  [](double x) { return !(std::abs(x) <= 1000); })) {
    return absl::InvalidArgumentError(
        "source.gnss_antenna_in_camera_m: three numbers of at most 1000");
  }
  if (max_out_of_order < 0) {
    return absl::InvalidArgumentError("source.max_out_of_order: must not be negative");
  }
  if (max_unreadable < 0) {
    return absl::InvalidArgumentError("source.max_unreadable: must not be negative");
  }
  if (start && end && start->is_time == end->is_time &&
      (end->index < start->index || end->since_start < start->since_start)) {
    return absl::InvalidArgumentError("source.end: lies before source.start");
  }
  return absl::OkStatus();
}

void AddImageSourceOptions(OptionTable* table, ImageSourceOptions* options) {
  OptionSection source = table->Section("source");
  source.Add("path", &options->path, "",
             "Folder or file of the images; /dev/videoN or N for a camera device.");
  source.AddChoice("type", &options->type,
                   {{"auto", ImageSourceType::kAuto},
                    {"euroc", ImageSourceType::kEuroc},
                    {"tum", ImageSourceType::kTum},
                    {"kitti", ImageSourceType::kKitti},
                    {"folder", ImageSourceType::kFolder},
                    {"video", ImageSourceType::kVideo},
                    {"device", ImageSourceType::kDevice}},
                   "Layout of the images; auto tells it by the content.");
  source.Add(
      "calibration", &options->calibration, "",
      "Calibration file (EuRoC sensor.yaml, plain calib.yaml, OpenCV/ROS camera_info, Kalibr "
      "camchain); empty takes the one that lies in the sequence.");
  source.Add("camera", &options->camera, "",
             "Which camera of a rig: camN of EuRoC and Kalibr, image_N of KITTI.");
  source.Add("stereo", &options->stereo, "", "Also reads the second camera's images.");
  source.Add(
      "imu", &options->imu, "",
      "Also reads the IMU file of the sequence; off, since a purely visual run need not fail "
      "for a damaged one.");
  source.Add("odometry", &options->odometry, "", "Wheel odometry CSV; empty for none.");
  source.Add("range", &options->range, "",
             "Folder of a laser range finder: data.csv with time [ns], range [m], and sensor.yaml; "
             "empty for none.");
  source.Add(
      "gnss", &options->gnss, "",
      "CSV of satellite positions: time [ns], latitude, longitude [deg], height above the "
      "ellipsoid [m], sigma horizontal, vertical [m]. Empty takes gnss.csv of the sequence's "
      "folder if there is one; none: no positions.");
  source.Add("gnss_antenna_in_camera_m", &options->gnss_antenna_in_camera_m, "m",
             "Where the receiver's antenna is: x, y, z in the camera frame.");
  source.Add("kitti_sequence", &options->kitti_sequence, "",
             "Sequence of a KITTI root that holds several, such as 00.");
  source.Add("frame_rate_hz", &options->frame_rate_hz, "Hz",
             "Rate of images without times; 0 takes the calibration's, for video the file's.");
  source.Add("start", &options->start, "",
             "First frame, by number from 0 (303) or by time since the first (12.5s).");
  source.Add("end", &options->end, "", "Last frame, included; as start.");
  source.Add("stride", &options->stride, "frames", "Takes every n-th frame.");
  source.Add("rate", &options->rate, "x real time",
             "0 runs as fast as it goes and drops no frame, so that runs are repeatable; otherwise "
             "frames come on time and those that cannot be kept up with are dropped.");
  source.Add("max_out_of_order", &options->max_out_of_order, "frames",
             "frames in a row whose times have gone back that are skipped before the run ends");
  source.Add("max_unreadable", &options->max_unreadable, "frames",
             "Missing or damaged images that are skipped before one ends the run; 0 is strict.");
  for (const char* name : {"start", "end", "stride", "rate", "calibration"}) {
    table->Alias(name, Concat("source.", name));
  }
  table->Alias("source", "source.type");
}

}  // namespace portolan
