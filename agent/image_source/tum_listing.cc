#include <array>

#include "agent/image_source/sequence_listing.h"

namespace portolan {
namespace {

namespace fs = std::filesystem;

// The colour cameras of the data set (its web page, "Intrinsic camera calibration"; the images of
// freiburg3 are rectified).
std::optional<CameraCalibration> PublishedCalibration(const fs::path& folder) {
  constexpr auto kRadTan = DistortionModel::kRadTan;
  CameraCalibration calibration;
  calibration.rate_hz = 30;
  const std::string name = fs::absolute(folder).lexically_normal().string();
  if (name.find("freiburg1") != std::string::npos) {
    calibration.intrinsics = {
        640,        480,        517.306408, 516.469215,
        318.643040, 255.313989, kRadTan,    {0.262383, -0.953104, -0.005358, 0.002628, 1.163314}};
  } else if (name.find("freiburg2") != std::string::npos) {
    calibration.intrinsics = {
        640,        480,        520.908620, 521.007327,
        325.141442, 249.701764, kRadTan,    {0.231222, -0.784899, -0.003257, -0.000105, 0.917205}};
  } else if (name.find("freiburg3") != std::string::npos) {
    calibration.intrinsics = {640, 480, 535.4, 539.2, 320.1, 247.6, DistortionModel::kNone, {}};
  } else {
    return std::nullopt;
  }
  return calibration;
}

}  // namespace

bool IsTumFolder(const fs::path& path) { return FileExists(path / "rgb.txt"); }

StatusOr<SequenceListing> ListTum(const ImageSourceOptions& options) {
  const fs::path folder = options.path;
  SequenceListing listing;
  PORTOLAN_ASSIGN_OR_RETURN(listing.frames, ReadFrameList(folder / "rgb.txt", {folder}));
  StatusOr<CameraCalibration> calibration =
      FindCalibration(options, options.camera, {folder / "calib.yaml", folder / "sensor.yaml"});
  if (!calibration.ok()) {
    const auto published = PublishedCalibration(folder);
    if (!options.calibration.empty() || !published || !absl::IsNotFound(calibration.status())) {
      return calibration.status();
    }
    calibration = *published;
  }
  listing.calibration = *calibration;
  return listing;
}

}  // namespace portolan
