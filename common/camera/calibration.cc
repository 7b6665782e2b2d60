#include "common/camera/calibration.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "common/base/concat.h"
#include "common/config/yaml_file.h"

namespace portolan {
namespace {

// A matrix farther than this from a rotation is a mistake, not rounding.
constexpr double kMaxRotationError = 1e-2;

// Nearest rigid motion of the 16 numbers of a 4x4 matrix, row by row.
StatusOr<Rigid3> ToRigid(const std::vector<double>& numbers) {
  if (numbers.size() != 16 && numbers.size() != 12) {
    return absl::InvalidArgumentError(
        Concat("expected a 4x4 matrix, got ", numbers.size(), " numbers"));
  }
  const Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>> top(numbers.data());
  if (numbers.size() == 16 &&
      (Eigen::Map<const Eigen::Vector4d>(numbers.data() + 12) - Eigen::Vector4d::UnitW()).norm() >
          1e-9) {
    return absl::InvalidArgumentError("the last row must be 0 0 0 1");
  }
  const Eigen::Matrix3d given = top.leftCols<3>();
  const Eigen::Matrix3d rotation = NearestRotation(given);
  if (!((rotation - given).norm() < kMaxRotationError)) {
    return absl::InvalidArgumentError("the 3x3 part is not a rotation");
  }
  return Rigid3{Eigen::Quaterniond(rotation).normalized(), top.col(3)};
}

StatusOr<Rigid3> ReadRigid(const YamlFile& file, const YAML::Node& parent, const std::string& key) {
  // Either {rows, cols, data} or rows of numbers.
  PORTOLAN_ASSIGN_OR_RETURN(const YAML::Node node, file.Child(parent, key));
  PORTOLAN_ASSIGN_OR_RETURN(const std::vector<double> numbers,
                            node.IsMap() ? file.Numbers(node, "data") : file.Numbers(parent, key));
  const StatusOr<Rigid3> rigid = ToRigid(numbers);
  if (!rigid.ok()) {
    return file.Error(node, Concat(key, ": ", std::string(rigid.status().message())));
  }
  return rigid;
}

// Sets the model and coefficients; `coefficients` in the model's usual order.
Status SetDistortion(const YamlFile& file, const YAML::Node& at, const std::string& model,
                     const std::vector<double>& coefficients, CameraIntrinsics* intrinsics) {
  const bool all_zero =
      std::all_of(coefficients.begin(), coefficients.end(), [](double k) { return k == 0; });
  size_t most;  // coefficients that the model can hold
  if (model == "none" || model.empty()) {
    intrinsics->distortion = DistortionModel::kNone;
    most = 0;
  } else if (model == "radtan" || model == "radial-tangential" || model == "plumb_bob" ||
             model == "rational_polynomial" || model == "brown") {
    intrinsics->distortion = DistortionModel::kRadTan;
    most = 5;
  } else if (model == "equidistant" || model == "fisheye" || model == "kannala_brandt") {
    intrinsics->distortion = DistortionModel::kEquidistant;
    most = 4;
  } else {
    return absl::UnimplementedError(
        std::string(file.Error(at, Concat("distortion_model '", model,
                                          "' is not supported; none, radtan (plumb_bob) or "
                                          "equidistant (fisheye)"))
                        .message()));
  }
  for (size_t i = 0; i < coefficients.size(); ++i) {
    if (i < most) {
      intrinsics->coefficients[i] = coefficients[i];
    } else if (coefficients[i] != 0) {
      return file.Error(at, Concat("distortion coefficient ", i, " must be 0: the model '", model,
                                   "' here has ", most));
    }
  }
  const bool must_be_complete = intrinsics->distortion == DistortionModel::kEquidistant ||
                                (intrinsics->distortion == DistortionModel::kRadTan && !all_zero);
  if (must_be_complete && coefficients.size() < 4) {
    return file.Error(
        at, Concat("distortion coefficients: expected at least 4, got ", coefficients.size()));
  }
  // A polynomial of zeros is the plain pinhole, and costs less.
  if (intrinsics->distortion == DistortionModel::kRadTan && all_zero) {
    intrinsics->distortion = DistortionModel::kNone;
  }
  return absl::OkStatus();
}

Status CheckPinhole(const YamlFile& file, const YAML::Node& node) {
  if (!YamlFile::Has(node, "camera_model")) return absl::OkStatus();
  PORTOLAN_ASSIGN_OR_RETURN(const std::string model, file.Text(node, "camera_model"));
  if (model == "pinhole") return absl::OkStatus();
  const Status status = file.Error(
      node["camera_model"], Concat("camera_model '", model, "' is not supported, only pinhole"));
  return absl::UnimplementedError(std::string(status.message()));
}

// The keys that EuRoC, Kalibr and calib.yaml share: `intrinsics` [fx fy cx cy] and the distortion.
Status ReadPinhole(const YamlFile& file, const YAML::Node& node, CameraIntrinsics* intrinsics) {
  PORTOLAN_RETURN_IF_ERROR(CheckPinhole(file, node));
  PORTOLAN_ASSIGN_OR_RETURN(const auto numbers, file.Numbers(node, "intrinsics"));
  if (numbers.size() != 4) {
    return file.Error(node["intrinsics"], Concat("intrinsics: expected [fx, fy, cx, cy], got ",
                                                 numbers.size(), " numbers"));
  }
  intrinsics->fx_px = numbers[0];
  intrinsics->fy_px = numbers[1];
  intrinsics->cx_px = numbers[2];
  intrinsics->cy_px = numbers[3];
  std::string model;
  std::vector<double> coefficients;
  if (YamlFile::Has(node, "distortion_model")) {
    PORTOLAN_ASSIGN_OR_RETURN(model, file.Text(node, "distortion_model"));
  }
  for (const char* key : {"distortion_coeffs", "distortion_coefficients"}) {
    if (!YamlFile::Has(node, key)) continue;
    PORTOLAN_ASSIGN_OR_RETURN(coefficients, file.Numbers(node, key));
  }
  if (model.empty() && !coefficients.empty()) {
    return file.Error(node, "key 'distortion_model' is missing");
  }
  return SetDistortion(file, node["distortion_model"], model, coefficients, intrinsics);
}

Status ReadResolution(const YamlFile& file, const YAML::Node& node, CameraIntrinsics* intrinsics) {
  if (YamlFile::Has(node, "resolution")) {
    PORTOLAN_ASSIGN_OR_RETURN(const auto size, file.Numbers(node, "resolution"));
    if (size.size() != 2 || size[0] != std::floor(size[0]) || size[1] != std::floor(size[1]) ||
        size[0] < 1 || size[1] < 1 || size[0] > 1e6 || size[1] > 1e6) {
      return file.Error(node["resolution"], "resolution: expected [width, height] in pixels");
    }
    intrinsics->width_px = static_cast<int>(size[0]);
    intrinsics->height_px = static_cast<int>(size[1]);
    return absl::OkStatus();
  }
  const bool long_names = YamlFile::Has(node, "image_width");
  PORTOLAN_ASSIGN_OR_RETURN(intrinsics->width_px,
                            file.Integer(node, long_names ? "image_width" : "width"));
  PORTOLAN_ASSIGN_OR_RETURN(intrinsics->height_px,
                            file.Integer(node, long_names ? "image_height" : "height"));
  return absl::OkStatus();
}

Status ReadRate(const YamlFile& file, const YAML::Node& node, CameraCalibration* calibration) {
  if (!YamlFile::Has(node, "rate_hz")) return absl::OkStatus();
  PORTOLAN_ASSIGN_OR_RETURN(const double rate_hz, file.Number(node, "rate_hz"));
  if (rate_hz < 0) return file.Error(node["rate_hz"], "rate_hz: must not be negative");
  if (rate_hz > 0) calibration->rate_hz = rate_hz;
  return absl::OkStatus();
}

Status ReadTimeOffset(const YamlFile& file, const YAML::Node& node,
                      CameraCalibration* calibration) {
  if (!YamlFile::Has(node, "timeshift_cam_imu")) return absl::OkStatus();
  PORTOLAN_ASSIGN_OR_RETURN(const double seconds, file.Number(node, "timeshift_cam_imu"));
  if (std::abs(seconds) > 10) {
    return file.Error(node["timeshift_cam_imu"], "timeshift_cam_imu: more than 10 s");
  }
  calibration->time_offset = FromSeconds(seconds);
  return absl::OkStatus();
}

// EuRoC sensor.yaml and the plain calib.yaml.
StatusOr<CameraCalibration> ReadSensorYaml(const YamlFile& file) {
  CameraCalibration calibration;
  PORTOLAN_RETURN_IF_ERROR(ReadResolution(file, file.root(), &calibration.intrinsics));
  PORTOLAN_RETURN_IF_ERROR(ReadPinhole(file, file.root(), &calibration.intrinsics));
  PORTOLAN_RETURN_IF_ERROR(ReadRate(file, file.root(), &calibration));
  PORTOLAN_RETURN_IF_ERROR(ReadTimeOffset(file, file.root(), &calibration));
  if (YamlFile::Has(file.root(), "T_BS")) {
    PORTOLAN_ASSIGN_OR_RETURN(calibration.body_from_camera, ReadRigid(file, file.root(), "T_BS"));
  }
  return calibration;
}

// Numbers under `key`, which is a list or a matrix with its own `data`.
StatusOr<std::vector<double>> ReadMatrixData(const YamlFile& file, const std::string& key) {
  PORTOLAN_ASSIGN_OR_RETURN(const YAML::Node node, file.Child(file.root(), key));
  return node.IsMap() ? file.Numbers(node, "data") : file.Numbers(file.root(), key);
}

StatusOr<CameraCalibration> ReadCameraInfo(const YamlFile& file) {
  CameraCalibration calibration;
  CameraIntrinsics& intrinsics = calibration.intrinsics;
  PORTOLAN_RETURN_IF_ERROR(ReadResolution(file, file.root(), &intrinsics));
  PORTOLAN_ASSIGN_OR_RETURN(const auto matrix, ReadMatrixData(file, "camera_matrix"));
  const YAML::Node at = file.root()["camera_matrix"];
  if (matrix.size() != 9) return file.Error(at, "camera_matrix: expected 9 numbers");
  if (matrix[1] != 0) return file.Error(at, "camera_matrix: skew is not supported");
  if (matrix[3] != 0 || matrix[6] != 0 || matrix[7] != 0 || matrix[8] != 1) {
    return file.Error(at, "camera_matrix: expected [fx 0 cx, 0 fy cy, 0 0 1]");
  }
  intrinsics.fx_px = matrix[0];
  intrinsics.cx_px = matrix[2];
  intrinsics.fy_px = matrix[4];
  intrinsics.cy_px = matrix[5];
  std::string model = "plumb_bob";  // OpenCV's own files do not say
  if (YamlFile::Has(file.root(), "distortion_model")) {
    PORTOLAN_ASSIGN_OR_RETURN(model, file.Text(file.root(), "distortion_model"));
  }
  std::vector<double> coefficients;
  if (YamlFile::Has(file.root(), "distortion_coefficients")) {
    PORTOLAN_ASSIGN_OR_RETURN(coefficients, ReadMatrixData(file, "distortion_coefficients"));
  }
  PORTOLAN_RETURN_IF_ERROR(SetDistortion(file, file.root()["distortion_coefficients"], model,
                                         coefficients, &intrinsics));
  PORTOLAN_RETURN_IF_ERROR(ReadRate(file, file.root(), &calibration));
  return calibration;
}

// One `camN` of a Kalibr camchain; `previous` is cam(N-1), null for the first.
StatusOr<CameraCalibration> ReadKalibrCamera(const YamlFile& file, const YAML::Node& node,
                                             const CameraCalibration* previous) {
  CameraCalibration calibration;
  PORTOLAN_RETURN_IF_ERROR(ReadResolution(file, node, &calibration.intrinsics));
  PORTOLAN_RETURN_IF_ERROR(ReadPinhole(file, node, &calibration.intrinsics));
  PORTOLAN_RETURN_IF_ERROR(ReadRate(file, node, &calibration));
  if (YamlFile::Has(node, "T_cam_imu")) {
    PORTOLAN_ASSIGN_OR_RETURN(const Rigid3 camera_from_imu, ReadRigid(file, node, "T_cam_imu"));
    calibration.body_from_camera = camera_from_imu.Inverse();
  } else if (previous != nullptr && YamlFile::Has(node, "T_cn_cnm1")) {
    PORTOLAN_ASSIGN_OR_RETURN(const Rigid3 camera_from_previous,
                              ReadRigid(file, node, "T_cn_cnm1"));
    // Without an IMU the first camera is the body.
    calibration.body_from_camera =
        previous->body_from_camera.value_or(Rigid3::Identity()) * camera_from_previous.Inverse();
  }
  PORTOLAN_RETURN_IF_ERROR(ReadTimeOffset(file, node, &calibration));
  return calibration;
}

StatusOr<std::vector<CameraCalibration>> ReadAnyFormat(const YamlFile& file) {
  std::vector<CameraCalibration> cameras;
  if (YamlFile::Has(file.root(), "cam0")) {
    for (int i = 0; YamlFile::Has(file.root(), Concat("cam", i)); ++i) {
      PORTOLAN_ASSIGN_OR_RETURN(CameraCalibration camera,
                                ReadKalibrCamera(file, file.root()[Concat("cam", i)],
                                                 cameras.empty() ? nullptr : &cameras.back()));
      cameras.push_back(std::move(camera));
    }
  } else if (YamlFile::Has(file.root(), "camera_matrix")) {
    PORTOLAN_ASSIGN_OR_RETURN(CameraCalibration camera, ReadCameraInfo(file));
    cameras.push_back(std::move(camera));
  } else if (YamlFile::Has(file.root(), "intrinsics")) {
    PORTOLAN_ASSIGN_OR_RETURN(CameraCalibration camera, ReadSensorYaml(file));
    cameras.push_back(std::move(camera));
  } else {
    return file.Error(file.root(),
                      "not a camera calibration: none of the keys 'intrinsics' (EuRoC, plain), "
                      "'camera_matrix' (OpenCV, ROS) and 'cam0' (Kalibr) is there");
  }
  return cameras;
}

}  // namespace

StatusOr<std::vector<CameraCalibration>> ReadCameraCalibrations(const std::filesystem::path& path) {
  PORTOLAN_ASSIGN_OR_RETURN(const YamlFile file, YamlFile::Load(path));
  PORTOLAN_ASSIGN_OR_RETURN(std::vector<CameraCalibration> cameras, ReadAnyFormat(file));
  for (size_t i = 0; i < cameras.size(); ++i) {
    const Status status = CameraModel::Create(cameras[i].intrinsics).status();
    if (!status.ok()) {
      return absl::InvalidArgumentError(
          Concat(path, ": camera ", i, ": ", std::string(status.message())));
    }
  }
  return cameras;
}

StatusOr<CameraCalibration> ReadCameraCalibration(const std::filesystem::path& path, int camera) {
  PORTOLAN_ASSIGN_OR_RETURN(std::vector<CameraCalibration> cameras, ReadCameraCalibrations(path));
  if (camera < 0 || camera >= static_cast<int>(cameras.size())) {
    return absl::InvalidArgumentError(
        Concat(path, ": has ", cameras.size(), " cameras, number ", camera, " is not among them"));
  }
  return std::move(cameras[camera]);
}

StatusOr<ImuCalibration> ReadImuCalibration(const std::filesystem::path& path) {
  PORTOLAN_ASSIGN_OR_RETURN(const YamlFile file, YamlFile::Load(path));
  // Kalibr nests under imu0 in its results.
  const YAML::Node node = YamlFile::Has(file.root(), "imu0") ? file.root()["imu0"] : file.root();
  ImuCalibration imu;
  const bool is_kalibr = YamlFile::Has(node, "update_rate");
  const std::pair<std::string, double*> fields[] = {
      {is_kalibr ? "update_rate" : "rate_hz", &imu.rate_hz},
      {"gyroscope_noise_density", &imu.gyroscope_noise_density},
      {"gyroscope_random_walk", &imu.gyroscope_random_walk},
      {"accelerometer_noise_density", &imu.accelerometer_noise_density},
      {"accelerometer_random_walk", &imu.accelerometer_random_walk}};
  for (const auto& [key, value] : fields) {
    PORTOLAN_ASSIGN_OR_RETURN(*value, file.Number(node, key));
    if (!(*value > 0)) return file.Error(node[key], Concat(key, ": must be positive"));
  }
  if (YamlFile::Has(node, "T_BS")) {
    PORTOLAN_ASSIGN_OR_RETURN(imu.body_from_imu, ReadRigid(file, node, "T_BS"));
  }
  return imu;
}

}  // namespace portolan
