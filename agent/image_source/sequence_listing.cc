#include "agent/image_source/sequence_listing.h"

#include <algorithm>

#include "absl/strings/str_join.h"
#include "agent/image_source/image_decoder.h"
#include "agent/image_source/sample_files.h"
#include "agent/image_source/text_lines.h"
#include "common/base/concat.h"

namespace portolan {
namespace {

namespace fs = std::filesystem;

// Whole numbers beyond this are nanoseconds since 1970, not seconds.
constexpr int64_t kLeastNanoseconds = 100'000'000'000'000;

// Seconds or nanoseconds: whole numbers of an ASL list (CSV) are nanoseconds.
StatusOr<Timestamp> ParseEitherTime(const std::string& text, bool is_csv) {
  if (text.find_first_of(".eE") == std::string::npos) {
    PORTOLAN_ASSIGN_OR_RETURN(const Timestamp time, ParseNanoseconds(text));
    if (is_csv || time.count() >= kLeastNanoseconds) return time;
  }
  return ParseSeconds(text);
}

fs::path FolderOf(const std::string& name, const std::vector<fs::path>& folders) {
  for (const fs::path& folder : folders) {
    if (FileExists(folder / name)) return folder;
  }
  return folders.front();
}

}  // namespace

bool FileExists(const fs::path& path) {
  std::error_code error;
  return fs::exists(path, error);
}

StatusOr<CameraCalibration> FindCalibration(const ImageSourceOptions& options, int camera,
                                            const std::vector<fs::path>& candidates) {
  fs::path file = options.calibration;
  for (const fs::path& candidate : candidates) {
    if (file.empty() && FileExists(candidate)) file = candidate;
  }
  if (file.empty()) {
    std::vector<std::string> names;
    for (const fs::path& candidate : candidates) names.push_back(candidate.string());
    return absl::NotFoundError(Concat("no camera calibration: give --calibration FILE; looked for ",
                                      absl::StrJoin(names, ", ")));
  }
  PORTOLAN_ASSIGN_OR_RETURN(const auto cameras, ReadCameraCalibrations(file));
  if (cameras.size() == 1) return cameras.front();
  return ReadCameraCalibration(file, camera);
}

StatusOr<std::vector<ListedFrame>> ReadFrameList(const fs::path& path,
                                                 const std::vector<fs::path>& folders) {
  const bool is_csv = path.extension() == ".csv";
  std::vector<ListedFrame> frames;
  fs::path folder;
  PORTOLAN_RETURN_IF_ERROR(ForEachLine(path, [&](const std::vector<std::string>& fields) -> Status {
    if (fields.size() < 2) return absl::InvalidArgumentError("expected a time and a file name");
    ListedFrame frame;
    PORTOLAN_ASSIGN_OR_RETURN(frame.time, ParseEitherTime(fields[0], is_csv));
    if (frames.empty()) folder = FolderOf(fields[1], folders);
    frame.image = folder / fields[1];
    frames.push_back(std::move(frame));
    return absl::OkStatus();
  }));
  if (frames.empty()) return absl::InvalidArgumentError(Concat(path, ": lists no images"));
  return frames;
}

std::vector<fs::path> SortedImages(const fs::path& folder) {
  std::vector<fs::path> images;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    if (HasImageExtension(entry->path())) images.push_back(entry->path());
  }
  std::sort(images.begin(), images.end());
  return images;
}

Status ReadImuInto(const fs::path& csv, const fs::path& yaml, SequenceListing* listing) {
  PORTOLAN_ASSIGN_OR_RETURN(listing->imu_calibration, ReadImuCalibration(yaml));
  PORTOLAN_ASSIGN_OR_RETURN(listing->imu, ReadImuCsv(csv));
  const Duration offset = listing->calibration.time_offset.value_or(Duration::zero());
  for (ImuSample& sample : listing->imu) sample.time -= offset;
  return absl::OkStatus();
}

}  // namespace portolan
