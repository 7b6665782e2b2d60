#include "common/camera/calibration.h"

#include "tests/support/data_path.h"
#include "tests/support/matchers.h"
#include "tests/support/temp_dir.h"

namespace portolan {
namespace {

using absl::StatusCode;
using testing::AllOf;
using testing::HasSubstr;

constexpr char kEuroc[] = R"(# General sensor definitions.
sensor_type: camera
comment: VI-Sensor cam0 (MT9M034)
T_BS:
  cols: 4
  rows: 4
  data: [0.0148655429818, -0.999880929698, 0.00414029679422, -0.0216401454975,
         0.999557249008, 0.0149672133247, 0.025715529948, -0.064676986768,
        -0.0257744366974, 0.00375618835797, 0.999660727178, 0.00981073058949,
         0.0, 0.0, 0.0, 1.0]
rate_hz: 20
resolution: [752, 480]
camera_model: pinhole
intrinsics: [458.654, 457.296, 367.215, 248.375] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]
)";

constexpr char kCameraInfo[] = R"(image_width: 640
image_height: 480
camera_name: narrow
camera_matrix:
  rows: 3
  cols: 3
  data: [500.5, 0, 320.25, 0, 501.5, 240.75, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0.1, -0.2, 0.001, 0.002, 0.03]
)";

constexpr char kOpenCv[] = R"(%YAML:1.0
---
calibration_time: "Mon Jan  1 10:00:00 2024"
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 5.005e+02, 0., 3.2025e+02, 0., 5.015e+02, 2.4075e+02, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ 0.1, -0.2, 0.001, 0.002, 0.03 ]
)";

constexpr char kKalibr[] = R"(cam0:
  T_cam_imu:
  - [0.0, 1.0, 0.0, 0.1]
  - [-1.0, 0.0, 0.0, 0.2]
  - [0.0, 0.0, 1.0, 0.3]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [0.0034823894, 0.0007150348, -0.0020532361, 0.0002029367]
  distortion_model: equidistant
  intrinsics: [190.97847, 190.97330, 254.93170, 256.89744]
  resolution: [512, 512]
  rostopic: /cam0/image_raw
  timeshift_cam_imu: 0.0025
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.11]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, 0.0001, 0.0002]
  distortion_model: radtan
  intrinsics: [450, 451, 370, 250]
  resolution: [752, 480]
)";

class CalibrationTest : public testing::Test {
 protected:
  StatusOr<CameraCalibration> Read(const std::string& text, int camera = 0) {
    return ReadCameraCalibration(dir_.Write("c.yaml", text), camera);
  }
  // `text` with the one occurrence of `from` replaced.
  static std::string Replaced(std::string text, const std::string& from, const std::string& to) {
    EXPECT_NE(text.find(from), std::string::npos);
    return text.replace(text.find(from), from.size(), to);
  }
  TempDir dir_;
};

TEST_F(CalibrationTest, ReadsEurocSensorYaml) {
  const auto calibration = Read(kEuroc);
  ASSERT_THAT(calibration, IsOk());
  const CameraIntrinsics expected{752,
                                  480,
                                  458.654,
                                  457.296,
                                  367.215,
                                  248.375,
                                  DistortionModel::kRadTan,
                                  {-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05, 0}};
  EXPECT_EQ(calibration->intrinsics, expected);
  EXPECT_EQ(calibration->rate_hz, 20);
  EXPECT_FALSE(calibration->time_offset);
  ASSERT_TRUE(calibration->body_from_camera);
  EXPECT_THAT(calibration->body_from_camera->translation,
              NearMatrix(Eigen::Vector3d(-0.0216401454975, -0.064676986768, 0.00981073058949), 0));
  EXPECT_NEAR(calibration->body_from_camera->Matrix()(0, 1), -0.999880929698, 1e-9);
}

TEST_F(CalibrationTest, ReadsRosCameraInfoAndOpenCvAlike) {
  const CameraIntrinsics expected{640,
                                  480,
                                  500.5,
                                  501.5,
                                  320.25,
                                  240.75,
                                  DistortionModel::kRadTan,
                                  {0.1, -0.2, 0.001, 0.002, 0.03}};
  for (const char* text : {kCameraInfo, kOpenCv}) {
    const auto calibration = Read(text);
    ASSERT_THAT(calibration, IsOk());
    EXPECT_EQ(calibration->intrinsics, expected);
    EXPECT_FALSE(calibration->body_from_camera);
  }
}

TEST_F(CalibrationTest, ReadsFisheyeCameraInfo) {
  const auto calibration =
      Read(Replaced(Replaced(kCameraInfo, "plumb_bob", "fisheye"), "0.002, 0.03]", "0.002]"));
  ASSERT_THAT(calibration, IsOk());
  EXPECT_EQ(calibration->intrinsics.distortion, DistortionModel::kEquidistant);
  EXPECT_EQ(calibration->intrinsics.coefficients[3], 0.002);
}

TEST_F(CalibrationTest, ReadsEveryCameraOfAKalibrChain) {
  const auto cameras = ReadCameraCalibrations(dir_.Write("k.yaml", kKalibr));
  ASSERT_THAT(cameras, IsOk());
  ASSERT_EQ(cameras->size(), 2u);
  const CameraCalibration& first = cameras->at(0);
  EXPECT_EQ(first.intrinsics.distortion, DistortionModel::kEquidistant);
  EXPECT_EQ(first.time_offset, Duration(2500000));
  // camera_from_imu maps the IMU's origin to (0.1, 0.2, 0.3).
  EXPECT_THAT(*first.body_from_camera * Eigen::Vector3d(0.1, 0.2, 0.3),
              NearMatrix(Eigen::Vector3d::Zero(), 1e-12));
  // The second camera stands 0.11 m along the first one's x axis.
  EXPECT_THAT(
      *cameras->at(1).body_from_camera,
      NearRigid(*first.body_from_camera * Rigid3{Eigen::Quaterniond::Identity(), {0.11, 0, 0}},
                1e-12));
}

TEST_F(CalibrationTest, CameraNumberOutOfRangeIsAnError) {
  EXPECT_THAT(Read(kKalibr, 1), IsOk());
  EXPECT_THAT(Read(kKalibr, 2), StatusIs(StatusCode::kInvalidArgument, HasSubstr("2 cameras")));
  EXPECT_THAT(Read(kEuroc, -1), StatusIs(StatusCode::kInvalidArgument));
}

TEST_F(CalibrationTest, ErrorsNameFileLineAndKey) {
  const auto code = StatusCode::kInvalidArgument;
  const auto in_file = [](const char* word) {
    return AllOf(HasSubstr("c.yaml:"), HasSubstr(word));
  };
  EXPECT_THAT(Read(Replaced(kEuroc, "intrinsics: [458.654, ", "intrinsics: [")),
              StatusIs(code, in_file(":14: intrinsics: expected [fx, fy, cx, cy], got 3")));
  EXPECT_THAT(Read(Replaced(kEuroc, "458.654", "abc")),
              StatusIs(code, in_file("intrinsics: entry 0")));
  EXPECT_THAT(Read(Replaced(kEuroc, "resolution: [752, 480]", "")),
              StatusIs(code, in_file("'width'")));
  EXPECT_THAT(Read(Replaced(kEuroc, "[752, 480]", "[752]")), StatusIs(code, in_file("resolution")));
  EXPECT_THAT(Read(Replaced(kEuroc, "0.0, 0.0, 0.0, 1.0]", "0, 0, 1]")),
              StatusIs(code, in_file("T_BS")));
  EXPECT_THAT(Read(Replaced(kEuroc, "0.999557249008", "0.5")),
              StatusIs(code, in_file("not a rotation")));
  EXPECT_THAT(Read(Replaced(kEuroc, "rate_hz: 20", "rate_hz: -1")),
              StatusIs(code, in_file("rate_hz")));
  EXPECT_THAT(Read(Replaced(kEuroc, "distortion_model: radial-tangential", "")),
              StatusIs(code, in_file("'distortion_model' is missing")));
  EXPECT_THAT(Read(Replaced(kEuroc, ", 0.00019359, 1.76187114e-05]", "]")),
              StatusIs(code, in_file("expected at least 4, got 2")));
  EXPECT_THAT(Read("a: 1\n"), StatusIs(code, HasSubstr("not a camera calibration")));
  EXPECT_THAT(Read(""), StatusIs(code, HasSubstr("not a camera calibration")));
  EXPECT_THAT(ReadCameraCalibration(dir_ / "none.yaml"), StatusIs(StatusCode::kNotFound));
}

TEST_F(CalibrationTest, ImplausibleCameraIsRefusedWithTheFileName) {
  EXPECT_THAT(
      Read(Replaced(kEuroc, "458.654", "-458.654")),
      StatusIs(StatusCode::kInvalidArgument, AllOf(HasSubstr("c.yaml"), HasSubstr("fx_px"))));
}

TEST_F(CalibrationTest, OtherCameraModelsAreUnimplemented) {
  EXPECT_THAT(Read(Replaced(kKalibr, "camera_model: pinhole", "camera_model: omni")),
              StatusIs(StatusCode::kUnimplemented, HasSubstr("omni")));
  EXPECT_THAT(Read(Replaced(kKalibr, "distortion_model: equidistant", "distortion_model: fov")),
              StatusIs(StatusCode::kUnimplemented, HasSubstr("fov")));
}

TEST_F(CalibrationTest, RationalPolynomialIsReadWhenItsExtraTermsAreZero) {
  const std::string rational = Replaced(kCameraInfo, "plumb_bob", "rational_polynomial");
  EXPECT_THAT(Read(Replaced(rational, "0.03]", "0.03, 0, 0, 0]")), IsOk());
  EXPECT_THAT(Read(Replaced(rational, "0.03]", "0.03, 0.5, 0, 0]")),
              StatusIs(StatusCode::kInvalidArgument, HasSubstr("coefficient 5")));
}

TEST_F(CalibrationTest, WrittenSensorYamlReadsBack) {
  CameraCalibration calibration = Read(kEuroc).value();
  calibration.time_offset = Duration(-1500000);
  for (const DistortionModel model :
       {DistortionModel::kRadTan, DistortionModel::kEquidistant, DistortionModel::kNone}) {
    calibration.intrinsics.distortion = model;
    if (model == DistortionModel::kNone) calibration.intrinsics.coefficients = {};
    ASSERT_THAT(WriteEurocSensorYaml(calibration, dir_ / "w.yaml"), IsOk());
    const auto back = ReadCameraCalibration(dir_ / "w.yaml");
    ASSERT_THAT(back, IsOk());
    EXPECT_EQ(back->intrinsics, calibration.intrinsics);
    EXPECT_EQ(back->rate_hz, calibration.rate_hz);
    EXPECT_EQ(back->time_offset, calibration.time_offset);
    EXPECT_THAT(*back->body_from_camera, NearRigid(*calibration.body_from_camera, 1e-15));
  }
  EXPECT_FALSE(WriteEurocSensorYaml(calibration, dir_ / "no" / "folder.yaml").ok());
}

TEST_F(CalibrationTest, WrittenImuYamlReadsBack) {
  ImuCalibration imu{200, 1.7e-4, 1.9e-5, 2e-3, 3e-3, Rigid3::Exp(Vector6d::Constant(0.1))};
  ASSERT_THAT(WriteEurocImuYaml(imu, dir_ / "imu.yaml"), IsOk());
  const auto back = ReadImuCalibration(dir_ / "imu.yaml");
  ASSERT_THAT(back, IsOk());
  EXPECT_EQ(back->rate_hz, 200);
  EXPECT_EQ(back->gyroscope_noise_density, 1.7e-4);
  EXPECT_EQ(back->gyroscope_random_walk, 1.9e-5);
  EXPECT_EQ(back->accelerometer_noise_density, 2e-3);
  EXPECT_EQ(back->accelerometer_random_walk, 3e-3);
  EXPECT_THAT(back->body_from_imu, NearRigid(imu.body_from_imu, 1e-15));
}

TEST_F(CalibrationTest, ImuYamlErrorsNameTheKey) {
  const auto code = StatusCode::kInvalidArgument;
  EXPECT_THAT(ReadImuCalibration(dir_.Write("i.yaml", "rate_hz: 200\n")),
              StatusIs(code, HasSubstr("gyroscope_noise_density")));
  EXPECT_THAT(ReadImuCalibration(dir_.Write("i.yaml", "rate_hz: 0\n")),
              StatusIs(code, HasSubstr("rate_hz: must be positive")));
  EXPECT_THAT(ReadImuCalibration(dir_.Write("i.yaml", "rate_hz: .nan\n")),
              StatusIs(code, HasSubstr("rate_hz")));
}

TEST_F(CalibrationTest, ReadsKittiProjections) {
  const auto path = dir_.Write("calib.txt",
                               "P0: 718.856 0 607.1928 0 0 718.856 185.2157 0 0 0 1 0\n"
                               "P1: 718.856 0 607.1928 -386.1448 0 718.856 185.2157 0 0 0 1 0\n");
  const auto right = ReadKittiCalibration(path, 1);
  ASSERT_THAT(right, IsOk());
  EXPECT_EQ(right->intrinsics.fx_px, 718.856);
  EXPECT_EQ(right->intrinsics.cy_px, 185.2157);
  EXPECT_NEAR(right->body_from_camera->translation.x(), 0.5371657, 1e-6);
  EXPECT_THAT(ReadKittiCalibration(path, 2),
              StatusIs(StatusCode::kInvalidArgument, HasSubstr("'P2:' is missing")));
  EXPECT_THAT(ReadKittiCalibration(dir_.Write("b.txt", "P0: 1 2 x\n"), 0),
              StatusIs(StatusCode::kInvalidArgument, HasSubstr("b.txt:1: P0: entry 2")));
}

class RealCalibrationTest : public testing::TestWithParam<const char*> {};

TEST_P(RealCalibrationTest, IsReadAndCovered) {
  PORTOLAN_REAL_DATA_OR_SKIP(folder, GetParam());
  const auto calibration = ReadCameraCalibration(folder / "calib.yaml");
  ASSERT_THAT(calibration, IsOk());
  const CameraModel camera = CameraModel::Create(calibration->intrinsics).value();
  const double right = camera.width_px() - 1, bottom = camera.height_px() - 1;
  for (const Eigen::Vector2d& corner :
       {Eigen::Vector2d(0, 0), Eigen::Vector2d(right, 0), Eigen::Vector2d(0, bottom),
        Eigen::Vector2d(right, bottom)}) {
    EXPECT_TRUE(camera.Unproject(corner)) << corner.transpose();
  }
}

INSTANTIATE_TEST_SUITE_P(Sequences, RealCalibrationTest,
                         testing::Values("7scenes/redkitchen_seq-01", "euroc/MH_01_easy_first18s",
                                         "euroc/V1_01_easy_keyframes", "kitti/odometry_00_first200",
                                         "monoslam_davison/scenelib_test_sequence",
                                         "openekf/desk_translation", "uzh_vamr/checkerboard_desk"));

TEST(RealImuCalibration, IsRead) {
  PORTOLAN_REAL_DATA_OR_SKIP(folder, "euroc/MH_01_easy_first18s");
  const auto imu = ReadImuCalibration(folder / "imu0.yaml");
  ASSERT_THAT(imu, IsOk());
  EXPECT_EQ(imu->rate_hz, 200);
}

}  // namespace
}  // namespace portolan
