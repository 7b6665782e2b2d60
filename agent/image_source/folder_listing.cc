#include <algorithm>

#include "agent/image_source/sequence_listing.h"
#include "agent/image_source/text_lines.h"
#include "common/base/concat.h"

namespace portolan {
namespace {

namespace fs = std::filesystem;

// Images without a list: named by nanoseconds, or evenly spaced at a known rate.
StatusOr<std::vector<ListedFrame>> ListUnlisted(const ImageSourceOptions& options,
                                                const fs::path& folder, double calibrated_rate_hz) {
  std::vector<fs::path> images = SortedImages(folder);
  if (images.empty()) images = SortedImages(folder / "images");
  if (images.empty()) {
    return absl::NotFoundError(
        Concat(folder, ": holds no images and no list of them (data.csv, times.txt)"));
  }
  const auto time_in_name = [](const fs::path& image) {
    const std::string stem = image.stem().string();
    return stem.size() >= 16 ? ParseNanoseconds(stem)
                             : StatusOr<Timestamp>(absl::NotFoundError("no time"));
  };
  const bool named_by_time = std::all_of(images.begin(), images.end(), [&](const fs::path& image) {
    return time_in_name(image).ok();
  });
  const double rate_hz = options.frame_rate_hz > 0 ? options.frame_rate_hz : calibrated_rate_hz;
  if (!named_by_time && !(rate_hz > 0)) {
    return absl::InvalidArgumentError(
        Concat(folder, ": images without times; give --source.frame_rate_hz or a times.txt"));
  }
  std::vector<ListedFrame> frames;
  for (fs::path& image : images) {
    const Timestamp time = named_by_time
                               ? *time_in_name(image)
                               : FromSeconds(static_cast<double>(frames.size()) / rate_hz);
    frames.push_back({time, std::move(image), {}});
  }
  return frames;
}

}  // namespace

StatusOr<SequenceListing> ListFolder(const ImageSourceOptions& options) {
  std::error_code error;
  fs::path list, folder = options.path;
  if (fs::is_regular_file(folder, error)) {
    list = folder;
    folder = list.parent_path();
  } else if (!fs::is_directory(folder, error)) {
    return absl::NotFoundError(Concat(folder, ": does not exist"));
  } else {
    for (const char* name : {"data.csv", "times.txt"}) {
      if (list.empty() && FileExists(folder / name)) list = folder / name;
    }
  }
  SequenceListing listing;
  PORTOLAN_ASSIGN_OR_RETURN(
      listing.calibration,
      FindCalibration(options, options.camera,
                      {folder / "calib.yaml", folder / "sensor.yaml", folder / "camera.yaml"}));
  if (list.empty()) {
    PORTOLAN_ASSIGN_OR_RETURN(
        listing.frames, ListUnlisted(options, folder, listing.calibration.rate_hz.value_or(0)));
  } else {
    PORTOLAN_ASSIGN_OR_RETURN(
        listing.frames,
        ReadFrameList(list, {folder, folder / "images", folder / "data", folder / "rgb"}));
  }
  if (options.stereo) {
    return absl::InvalidArgumentError("source.stereo: a plain folder has one camera only");
  }
  if (options.imu) {
    PORTOLAN_RETURN_IF_ERROR(ReadImuInto(folder / "imu0.csv", folder / "imu0.yaml", &listing));
  }
  return listing;
}

}  // namespace portolan
