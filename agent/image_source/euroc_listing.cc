#include <algorithm>

#include "agent/image_source/sequence_listing.h"
#include "common/base/concat.h"
#include "common/base/logging.h"

namespace portolan {
namespace {

namespace fs = std::filesystem;

// Images of two cameras that were triggered together differ by less than this.
constexpr Duration kMaxStereoOffset = std::chrono::milliseconds(2);

fs::path MavFolder(const fs::path& path) {
  return FileExists(path / "mav0") ? path / "mav0" : path;
}

// For each frame the right image nearest in time, if it was taken at the same instant.
void PairWithRight(std::vector<ListedFrame> right, std::vector<ListedFrame>* frames) {
  std::sort(right.begin(), right.end(),
            [](const ListedFrame& a, const ListedFrame& b) { return a.time < b.time; });
  size_t alone = 0;
  for (ListedFrame& frame : *frames) {
    const auto match = std::lower_bound(
        right.begin(), right.end(), frame.time - kMaxStereoOffset,
        [](const ListedFrame& candidate, Timestamp time) { return candidate.time < time; });
    if (match != right.end() && match->time <= frame.time + kMaxStereoOffset) {
      frame.right = match->image;
    } else {
      ++alone;
    }
  }
  if (alone > 0)
    LogWarning(alone, " of ", frames->size(), " images have no partner in the right camera");
}

}  // namespace

bool IsEurocFolder(const fs::path& path) {
  return FileExists(MavFolder(path) / "cam0") || FileExists(path / "mav0");
}

StatusOr<SequenceListing> ListEuroc(const ImageSourceOptions& options) {
  const fs::path mav = MavFolder(options.path);
  const fs::path camera = mav / Concat("cam", options.camera);
  SequenceListing listing;
  PORTOLAN_ASSIGN_OR_RETURN(listing.frames,
                            ReadFrameList(camera / "data.csv", {camera / "data", camera}));
  PORTOLAN_ASSIGN_OR_RETURN(listing.calibration,
                            FindCalibration(options, options.camera, {camera / "sensor.yaml"}));
  if (options.stereo) {
    const int right_number = options.camera + 1;
    const fs::path right = mav / Concat("cam", right_number);
    PORTOLAN_ASSIGN_OR_RETURN(listing.right_calibration,
                              FindCalibration(options, right_number, {right / "sensor.yaml"}));
    PORTOLAN_ASSIGN_OR_RETURN(auto right_frames,
                              ReadFrameList(right / "data.csv", {right / "data", right}));
    PairWithRight(std::move(right_frames), &listing.frames);
  }
  if (options.imu) {
    const fs::path imu = mav / "imu0";
    PORTOLAN_RETURN_IF_ERROR(ReadImuInto(imu / "data.csv", imu / "sensor.yaml", &listing));
  }
  return listing;
}

}  // namespace portolan
