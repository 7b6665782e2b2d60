#include <algorithm>

#include "absl/strings/str_join.h"
#include "agent/image_source/image_decoder.h"
#include "agent/image_source/sequence_listing.h"
#include "agent/image_source/text_lines.h"
#include "common/base/concat.h"

namespace portolan {
namespace {

namespace fs = std::filesystem;

bool IsSequence(const fs::path& path) {
  return FileExists(path / "times.txt") &&
         (FileExists(path / "image_0") || FileExists(path / "image_2"));
}

// The folder of the sequence: the path itself, or one under sequences/.
StatusOr<fs::path> SequenceFolder(const ImageSourceOptions& options) {
  const fs::path path = options.path;
  if (IsSequence(path)) return path;
  const fs::path root = FileExists(path / "sequences") ? path / "sequences" : path;
  if (!options.kitti_sequence.empty()) {
    if (IsSequence(root / options.kitti_sequence)) return root / options.kitti_sequence;
    return absl::NotFoundError(
        Concat(root / options.kitti_sequence, ": is no KITTI sequence (times.txt, image_0)"));
  }
  std::vector<std::string> found;
  std::error_code error;
  for (fs::directory_iterator entry(root, error), end; !error && entry != end;
       entry.increment(error)) {
    if (IsSequence(entry->path())) found.push_back(entry->path().filename().string());
  }
  std::sort(found.begin(), found.end());
  if (found.size() == 1) return root / found.front();
  if (found.empty()) return absl::NotFoundError(Concat(root, ": holds no KITTI sequence"));
  return absl::InvalidArgumentError(Concat(root, ": holds the sequences ",
                                           absl::StrJoin(found, ", "),
                                           "; give --source.kitti_sequence"));
}

StatusOr<CameraCalibration> CalibrationOf(const ImageSourceOptions& options, const fs::path& folder,
                                          int camera, const fs::path& first_image) {
  if (!options.calibration.empty() || !FileExists(folder / "calib.txt")) {
    return FindCalibration(options, camera, {folder / "calib.yaml"});
  }
  PORTOLAN_ASSIGN_OR_RETURN(CameraCalibration calibration,
                            ReadKittiCalibration(folder / "calib.txt", camera));
  // The file does not state the size of the images; the images do.
  ImageDecoder decoder;
  PORTOLAN_ASSIGN_OR_RETURN(const cv::Mat image, decoder.DecodeGray(first_image));
  calibration.intrinsics.width_px = image.cols;
  calibration.intrinsics.height_px = image.rows;
  const Status status = CameraModel::Create(calibration.intrinsics).status();
  if (!status.ok()) {
    return absl::InvalidArgumentError(
        Concat(folder / "calib.txt", ": ", std::string(status.message())));
  }
  return calibration;
}

}  // namespace

bool IsKittiFolder(const fs::path& path) {
  return IsSequence(path) || FileExists(path / "sequences");
}

StatusOr<SequenceListing> ListKitti(const ImageSourceOptions& options) {
  PORTOLAN_ASSIGN_OR_RETURN(const fs::path folder, SequenceFolder(options));
  int camera = options.camera;
  // A download of the colour images alone has cameras 2 and 3.
  if (camera < 2 && !FileExists(folder / Concat("image_", camera))) camera += 2;
  const std::vector<fs::path> images = SortedImages(folder / Concat("image_", camera));
  std::vector<fs::path> right;
  if (options.stereo) right = SortedImages(folder / Concat("image_", camera + 1));

  SequenceListing listing;
  PORTOLAN_RETURN_IF_ERROR(
      ForEachLine(folder / "times.txt", [&](const std::vector<std::string>& fields) -> Status {
        const size_t i = listing.frames.size();
        ListedFrame frame;
        PORTOLAN_ASSIGN_OR_RETURN(frame.time, ParseSeconds(fields[0]));
        if (i < images.size()) frame.image = images[i];
        if (i < right.size()) frame.right = right[i];
        listing.frames.push_back(std::move(frame));
        return absl::OkStatus();
      }));
  if (images.empty() || listing.frames.size() != images.size() ||
      (options.stereo && right.size() != images.size())) {
    return absl::InvalidArgumentError(
        Concat(folder / "times.txt", ": has ", listing.frames.size(), " times, but image_", camera,
               " has ", images.size(), " images",
               options.stereo ? Concat(" and its partner ", right.size()) : ""));
  }
  PORTOLAN_ASSIGN_OR_RETURN(listing.calibration,
                            CalibrationOf(options, folder, camera, images.front()));
  if (options.stereo) {
    PORTOLAN_ASSIGN_OR_RETURN(listing.right_calibration,
                              CalibrationOf(options, folder, camera + 1, right.front()));
  }
  return listing;
}

}  // namespace portolan
