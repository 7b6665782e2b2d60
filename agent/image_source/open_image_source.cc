#include <algorithm>
#include <filesystem>
#include <utility>

#include "absl/strings/ascii.h"
#include "agent/image_source/device_source.h"
#include "agent/image_source/image_source.h"
#include "agent/image_source/listed_stream.h"
#include "agent/image_source/playback_source.h"
#include "agent/image_source/sample_files.h"
#include "agent/image_source/sequence_listing.h"
#include "agent/image_source/video_stream.h"
#include "common/base/concat.h"

namespace portolan {
namespace {

namespace fs = std::filesystem;

// Samples before the first frame that are kept: enough to initialise an IMU at rest.
constexpr Duration kSampleLead = std::chrono::seconds(2);

bool IsVideoFile(const fs::path& path) {
  const std::string extension = absl::AsciiStrToLower(path.extension().string());
  for (const char* known :
       {".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg", ".mjpeg", ".ogv"}) {
    if (extension == known) return true;
  }
  return false;
}

StatusOr<ImageSourceType> DetectType(const std::string& path) {
  std::error_code error;
  if (fs::is_directory(path, error)) {
    if (IsEurocFolder(path)) return ImageSourceType::kEuroc;
    if (IsTumFolder(path)) return ImageSourceType::kTum;
    if (IsKittiFolder(path)) return ImageSourceType::kKitti;
    return ImageSourceType::kFolder;
  }
  if (fs::is_regular_file(path, error)) {
    return IsVideoFile(path) ? ImageSourceType::kVideo : ImageSourceType::kFolder;
  }
  if (ParseDevice(path)) return ImageSourceType::kDevice;
  return absl::NotFoundError(Concat(path, ": does not exist"));
}

StatusOr<SequenceListing> ListSequence(const ImageSourceOptions& options, ImageSourceType type) {
  if (type == ImageSourceType::kEuroc) return ListEuroc(options);
  if (options.imu && type != ImageSourceType::kFolder) {
    return absl::InvalidArgumentError(
        Concat(options.path, ": source.imu: this layout has no IMU file"));
  }
  if (type == ImageSourceType::kTum) return ListTum(options);
  if (type == ImageSourceType::kKitti) return ListKitti(options);
  return ListFolder(options);
}

// Frames of the range, and the time of the first.
std::pair<int64_t, std::optional<Timestamp>> CountInRange(const ImageSourceOptions& options,
                                                          const std::vector<ListedFrame>& frames) {
  FrameRange range(options);
  std::pair<int64_t, std::optional<Timestamp>> result;
  for (size_t i = 0; i < frames.size(); ++i) {
    const FrameRange::Place place = range.PlaceOf(static_cast<int64_t>(i), frames[i].time);
    if (place == FrameRange::Place::kBeyond) break;
    if (place != FrameRange::Place::kTaken) continue;
    ++result.first;
    if (!result.second) result.second = frames[i].time;
  }
  return result;
}

template <typename Sample>
void RemoveBefore(Timestamp time, std::vector<Sample>* samples) {
  samples->erase(samples->begin(),
                 std::find_if(samples->begin(), samples->end(),
                              [&](const Sample& sample) { return sample.time >= time; }));
}

// The file that the options name, or the one that lies in the sequence; empty for none.
fs::path FindGnssFile(const ImageSourceOptions& options) {
  if (options.gnss == "none") return {};
  if (!options.gnss.empty()) return options.gnss;
  std::error_code error;
  const fs::path path = options.path;
  const fs::path folder = fs::is_directory(path, error) ? path : path.parent_path();
  for (const fs::path& candidate : {folder / "gnss.csv", folder / "mav0" / "gnss.csv"}) {
    if (FileExists(candidate)) return candidate;
  }
  return {};
}

StatusOr<std::vector<GnssFix>> ReadGnss(const ImageSourceOptions& options, ImageSourceInfo* info) {
  const fs::path file = FindGnssFile(options);
  if (file.empty()) return std::vector<GnssFix>();
  PORTOLAN_ASSIGN_OR_RETURN(std::vector<GnssFix> fixes, ReadGnssCsv(file));
  info->has_gnss = true;
  const std::vector<double>& antenna = options.gnss_antenna_in_camera_m;
  info->antenna_in_camera_m = {antenna[0], antenna[1], antenna[2]};
  return fixes;
}

StatusOr<std::vector<RangeSample>> ReadRanges(const ImageSourceOptions& options,
                                              ImageSourceInfo* info) {
  if (options.range.empty()) return std::vector<RangeSample>();
  const fs::path folder = options.range;
  PORTOLAN_ASSIGN_OR_RETURN(info->range_finder, ReadRangeFinder(folder / "sensor.yaml"));
  return ReadRangeCsv(folder / "data.csv");
}

StatusOr<std::unique_ptr<ImageSource>> OpenSequence(const ImageSourceOptions& options,
                                                    ImageSourceType type) {
  PORTOLAN_ASSIGN_OR_RETURN(SequenceListing listing, ListSequence(options, type));
  const auto [count, first_time] = CountInRange(options, listing.frames);
  if (!first_time) {
    return absl::InvalidArgumentError(
        Concat(options.path, ": no frame lies in the range; there are ", listing.frames.size()));
  }
  std::vector<OdometrySample> odometry;
  if (!options.odometry.empty()) {
    PORTOLAN_ASSIGN_OR_RETURN(odometry, ReadOdometryCsv(options.odometry));
  }
  RemoveBefore(*first_time - kSampleLead, &listing.imu);
  RemoveBefore(*first_time - kSampleLead, &odometry);
  ImageSourceInfo info;
  info.type = type;
  info.description = Concat(options.path, ", ", count, " images");
  info.frame_count = count;
  info.calibration = listing.calibration;
  info.right_calibration = listing.right_calibration;
  info.imu_calibration = listing.imu_calibration;
  info.has_odometry = !options.odometry.empty();
  PORTOLAN_ASSIGN_OR_RETURN(std::vector<GnssFix> gnss, ReadGnss(options, &info));
  RemoveBefore(*first_time, &gnss);
  PORTOLAN_ASSIGN_OR_RETURN(std::vector<RangeSample> ranges, ReadRanges(options, &info));
  return std::unique_ptr<ImageSource>(std::make_unique<PlaybackSource>(
      options, std::move(info), std::make_unique<ListedStream>(std::move(listing.frames)),
      std::move(listing.imu), std::move(odometry), std::move(gnss), std::move(ranges)));
}

StatusOr<std::unique_ptr<ImageSource>> OpenVideo(const ImageSourceOptions& options) {
  const fs::path path = options.path;
  fs::path beside = path;
  PORTOLAN_ASSIGN_OR_RETURN(
      const CameraCalibration calibration,
      FindCalibration(options, options.camera,
                      {beside.replace_extension(".yaml"), path.parent_path() / "calib.yaml"}));
  PORTOLAN_ASSIGN_OR_RETURN(auto stream, VideoStream::Open(options.path, options.frame_rate_hz));
  ImageSourceInfo info;
  info.type = ImageSourceType::kVideo;
  info.description = Concat(options.path, ", video at ", stream->frame_rate_hz(), " Hz");
  if (!options.start && !options.end && options.stride == 1) {
    info.frame_count = stream->frame_count();
  }
  info.calibration = calibration;
  info.has_odometry = !options.odometry.empty();
  std::vector<OdometrySample> odometry;
  if (!options.odometry.empty()) {
    PORTOLAN_ASSIGN_OR_RETURN(odometry, ReadOdometryCsv(options.odometry));
  }
  std::vector<GnssFix> gnss;
  if (!options.gnss.empty()) {
    PORTOLAN_ASSIGN_OR_RETURN(gnss, ReadGnss(options, &info));
  }
  PORTOLAN_ASSIGN_OR_RETURN(std::vector<RangeSample> ranges, ReadRanges(options, &info));
  return std::unique_ptr<ImageSource>(std::make_unique<PlaybackSource>(
      options, std::move(info), std::move(stream), std::vector<ImuSample>(), std::move(odometry),
      std::move(gnss), std::move(ranges)));
}

StatusOr<std::unique_ptr<ImageSource>> OpenDevice(const ImageSourceOptions& options) {
  const std::optional<int> device = ParseDevice(options.path);
  if (!device) {
    return absl::InvalidArgumentError(
        Concat("'", options.path, "' is no camera device; give /dev/videoN or N"));
  }
  ImageSourceInfo info;
  info.type = ImageSourceType::kDevice;
  info.description = Concat("camera device ", *device);
  PORTOLAN_ASSIGN_OR_RETURN(info.calibration, FindCalibration(options, options.camera, {}));
  PORTOLAN_ASSIGN_OR_RETURN(
      auto grabber, OpenCameraGrabber(*device, info.calibration.intrinsics, options.frame_rate_hz));
  return std::unique_ptr<ImageSource>(
      std::make_unique<DeviceSource>(options, std::move(info), std::move(grabber)));
}

}  // namespace

StatusOr<std::unique_ptr<ImageSource>> OpenImageSource(const ImageSourceOptions& options) {
  PORTOLAN_RETURN_IF_ERROR(options.Validate());
  ImageSourceType type = options.type;
  if (type == ImageSourceType::kAuto) {
    PORTOLAN_ASSIGN_OR_RETURN(type, DetectType(options.path));
  }
  if (type != ImageSourceType::kVideo && type != ImageSourceType::kDevice) {
    return OpenSequence(options, type);
  }
  if (options.imu || options.stereo) {
    return absl::InvalidArgumentError(
        "source.imu, source.stereo: a video or device has one camera and no IMU");
  }
  if (type == ImageSourceType::kDevice && !options.range.empty()) {
    return absl::InvalidArgumentError(
        "source.range: a camera device comes without recorded ranges");
  }
  return type == ImageSourceType::kVideo ? OpenVideo(options) : OpenDevice(options);
}

}  // namespace portolan
