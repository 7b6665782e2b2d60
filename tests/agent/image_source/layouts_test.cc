// Each layout, written small, is told by its content and read.
#include <fstream>

#include "tests/agent/image_source/test_images.h"
#include "tests/support/matchers.h"

namespace portolan {
namespace {

using absl::StatusCode;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

class LayoutsTest : public testing::Test {
 protected:
  ImageSourceOptions Options() const {
    ImageSourceOptions options;
    options.path = dir_.path().string();
    return options;
  }
  // mav0/camN with images of the given values at 0.1 s steps from 1 s.
  void WriteEurocCamera(int camera, const std::vector<int>& values) const {
    std::string list = "#timestamp [ns],filename\r\n";
    const std::string folder = Concat("mav0/cam", camera, "/");
    for (size_t i = 0; i < values.size(); ++i) {
      const std::string name = Concat(1000000000 + i * 100000000, ".png");
      WriteImage(dir_ / (folder + "data/" + name), FlatImage(values[i]));
      list += Concat(1000000000 + i * 100000000, ",", name, "\r\n");
    }
    dir_.Write(folder + "data.csv", list);
    dir_.Write(folder + "sensor.yaml", TestSensorYaml());
  }
  void WriteKittiSequence(const std::string& folder, const std::string& images) const {
    for (int i = 0; i < 3; ++i) {
      WriteImage(dir_ / Concat(folder, images, "/00000", i, ".png"), FlatImage(i + 5));
    }
    dir_.Write(folder + "times.txt", "0.000000e+00\n1.037875e-01\n2.075e-01\n");
    dir_.Write(folder + "calib.txt",
               "P0: 30 0 16 0 0 30 12 0 0 0 1 0\nP1: 30 0 16 -15 0 30 12 0 0 0 1 0\n"
               "P2: 31 0 16 0 0 31 12 0 0 0 1 0\n");
  }
  TempDir dir_;
};

TEST_F(LayoutsTest, Euroc) {
  WriteEurocCamera(0, {1, 2, 3});
  const auto source = OpenOrFail(Options());
  ASSERT_TRUE(source);
  EXPECT_EQ(source->info().type, ImageSourceType::kEuroc);
  EXPECT_EQ(source->info().frame_count, 3);
  EXPECT_TRUE(source->calibration().body_from_camera);
  const auto frame = source->Next();
  ASSERT_THAT(frame, IsOk());
  EXPECT_EQ((*frame)->time, FromSeconds(1));
  EXPECT_EQ((*frame)->index, 0);
  EXPECT_THAT((*frame)->name, HasSubstr("1000000000.png"));
  EXPECT_TRUE((*frame)->right.empty());
  EXPECT_THAT(PixelValues(*source), ElementsAre(2, 3));
}

TEST_F(LayoutsTest, EurocStereoPairsByTime) {
  WriteEurocCamera(0, {1, 2, 3});
  WriteEurocCamera(1, {11, 12});
  ImageSourceOptions options = Options();
  options.stereo = true;
  const auto source = OpenOrFail(options);
  ASSERT_TRUE(source);
  EXPECT_TRUE(source->info().right_calibration);
  EXPECT_EQ((*source->Next())->right.at<uchar>(0, 0), 11);
  EXPECT_EQ((*source->Next())->right.at<uchar>(0, 0), 12);
  EXPECT_TRUE((*source->Next())->right.empty());
}

TEST_F(LayoutsTest, EurocImuIsTakenPieceByPiece) {
  WriteEurocCamera(0, {1, 2, 3});
  std::string imu = "#timestamp,...\n";
  for (int i = -500; i <= 130; ++i) imu += Concat(1000000000LL + i * 10000000LL, ",0,0,0,0,0,9\n");
  dir_.Write("mav0/imu0/data.csv", imu);
  dir_.Write("mav0/imu0/sensor.yaml",
             "rate_hz: 100\ngyroscope_noise_density: 1e-4\ngyroscope_random_walk: 1e-5\n"
             "accelerometer_noise_density: 1e-3\naccelerometer_random_walk: 1e-3\n");
  ImageSourceOptions options = Options();
  options.imu = true;
  options.start = FrameLimit::Index(1);
  const auto source = OpenOrFail(options);
  ASSERT_TRUE(source);
  EXPECT_EQ(source->info().imu_calibration->rate_hz, 100);
  const Timestamp first = (*source->Next())->time;
  const auto before = source->TakeImu(first);
  ASSERT_EQ(before.size(), 201u);  // two seconds before the first frame of the range
  EXPECT_EQ(before.front().time, first - FromSeconds(2));
  EXPECT_EQ(before.back().time, first);
  EXPECT_EQ(source->TakeImu((*source->Next())->time).size(), 10u);
  EXPECT_TRUE(source->TakeImu(first).empty());
}

TEST_F(LayoutsTest, TimeOffsetIsTakenOffTheImuTimes) {
  WriteTestFolder(dir_, 2);
  dir_.Write("calib.yaml", TestCalibrationText() + "timeshift_cam_imu: 0.5\n");
  dir_.Write("imu0.csv", "100500000000,0,0,0,0,0,9\n");
  dir_.Write("imu0.yaml",
             "rate_hz: 100\ngyroscope_noise_density: 1e-4\ngyroscope_random_walk: 1e-5\n"
             "accelerometer_noise_density: 1e-3\naccelerometer_random_walk: 1e-3\n");
  ImageSourceOptions options = Options();
  options.imu = true;
  const auto source = OpenOrFail(options);
  ASSERT_TRUE(source);
  EXPECT_EQ(source->TakeImu(FromSeconds(100)).at(0).time, FromSeconds(100));
}

TEST_F(LayoutsTest, DamagedOrMissingImuIsAnErrorWhenAskedFor) {
  WriteEurocCamera(0, {1});
  ImageSourceOptions options = Options();
  options.imu = true;
  EXPECT_THAT(OpenImageSource(options), StatusIs(StatusCode::kNotFound, HasSubstr("imu0")));
  dir_.Write("mav0/imu0/sensor.yaml",
             "rate_hz: 100\ngyroscope_noise_density: 1e-4\ngyroscope_random_walk: 1e-5\n"
             "accelerometer_noise_density: 1e-3\naccelerometer_random_walk: 1e-3\n");
  dir_.Write("mav0/imu0/data.csv", "1,0,0,0,0,0,NaN\n");
  EXPECT_THAT(OpenImageSource(options),
              StatusIs(StatusCode::kInvalidArgument, HasSubstr("data.csv:1:")));
  options.imu = false;
  EXPECT_THAT(OpenImageSource(options), IsOk());
}

TEST_F(LayoutsTest, Tum) {
  cv::Mat colour(480, 640, CV_8UC3, cv::Scalar(10, 20, 30));
  WriteImage(dir_ / "rgbd_dataset_freiburg1_xyz/rgb/a.png", colour);
  dir_.Write("rgbd_dataset_freiburg1_xyz/rgb.txt",
             "# color images\n# timestamp filename\n1305031102.175304 rgb/a.png\n");
  ImageSourceOptions options = Options();
  options.path += "/rgbd_dataset_freiburg1_xyz";
  const auto source = OpenOrFail(options);
  ASSERT_TRUE(source);
  EXPECT_EQ(source->info().type, ImageSourceType::kTum);
  EXPECT_NEAR(source->calibration().intrinsics.fx_px, 517.306408, 1e-9);
  const auto frame = source->Next();
  ASSERT_THAT(frame, IsOk());
  EXPECT_EQ((*frame)->time.count(), 1305031102175304000);
  EXPECT_NEAR((*frame)->gray.at<uchar>(0, 0), 22, 1);
}

TEST_F(LayoutsTest, TumElsewhereNeedsACalibration) {
  dir_.Write("rgb.txt", "1.0 rgb/a.png\n");
  EXPECT_THAT(OpenImageSource(Options()),
              StatusIs(StatusCode::kNotFound, HasSubstr("--calibration")));
}

TEST_F(LayoutsTest, KittiTakesTheImageSizeFromTheImages) {
  WriteKittiSequence("", "image_0");
  const auto source = OpenOrFail(Options());
  ASSERT_TRUE(source);
  EXPECT_EQ(source->info().type, ImageSourceType::kKitti);
  EXPECT_EQ(source->calibration().intrinsics.width_px, kTestWidth);
  EXPECT_EQ(source->calibration().intrinsics.fx_px, 30);
  EXPECT_EQ((*source->Next())->time.count(), 0);
  EXPECT_EQ((*source->Next())->time.count(), 103787500);
}

TEST_F(LayoutsTest, KittiColourFallsBackToCameraTwo) {
  WriteKittiSequence("", "image_2");
  const auto source = OpenOrFail(Options());
  ASSERT_TRUE(source);
  EXPECT_EQ(source->calibration().intrinsics.fx_px, 31);
  EXPECT_THAT(PixelValues(*source), ElementsAre(5, 6, 7));
}

TEST_F(LayoutsTest, KittiRootWithSeveralSequencesAsksWhich) {
  WriteKittiSequence("sequences/00/", "image_0");
  EXPECT_THAT(OpenImageSource(Options()), IsOk());
  WriteKittiSequence("sequences/07/", "image_0");
  EXPECT_THAT(OpenImageSource(Options()),
              StatusIs(StatusCode::kInvalidArgument, HasSubstr("00, 07")));
  ImageSourceOptions options = Options();
  options.kitti_sequence = "07";
  EXPECT_THAT(OpenImageSource(options), IsOk());
  options.kitti_sequence = "08";
  EXPECT_THAT(OpenImageSource(options), StatusIs(StatusCode::kNotFound, HasSubstr("08")));
}

TEST_F(LayoutsTest, KittiTimesAndImagesMustBeAsMany) {
  WriteKittiSequence("", "image_0");
  std::filesystem::remove(dir_ / "image_0" / "000001.png");
  EXPECT_THAT(
      OpenImageSource(Options()),
      StatusIs(StatusCode::kInvalidArgument, AllOf(HasSubstr("3 times"), HasSubstr("2 images"))));
}

TEST_F(LayoutsTest, FolderWithTimes) {
  WriteTestFolder(dir_, 4);
  const auto source = OpenOrFail(Options());
  ASSERT_TRUE(source);
  EXPECT_EQ(source->info().type, ImageSourceType::kFolder);
  EXPECT_EQ((*source->Next())->time, FromSeconds(100));
  EXPECT_THAT(PixelValues(*source), ElementsAre(1, 2, 3));
}

TEST_F(LayoutsTest, ListItselfIsAccepted) {
  WriteTestFolder(dir_, 2);
  ImageSourceOptions options = Options();
  options.path += "/times.txt";
  const auto source = OpenOrFail(options);
  ASSERT_TRUE(source);
  EXPECT_THAT(PixelValues(*source), ElementsAre(0, 1));
}

TEST_F(LayoutsTest, NanosecondListNamesImagesInASubfolder) {
  WriteImage(dir_ / "images/x.png", FlatImage(9));
  dir_.Write("data.csv", "#timestamp [ns],filename\n1403636584763555584,x.png\n");
  dir_.Write("calib.yaml", TestCalibrationText());
  const auto source = OpenOrFail(Options());
  ASSERT_TRUE(source);
  EXPECT_EQ((*source->Next())->time.count(), 1403636584763555584);
}

TEST_F(LayoutsTest, ImagesWithoutAListAreNamedByTimeOrEvenlySpaced) {
  WriteImage(dir_ / "b.png", FlatImage(2));
  WriteImage(dir_ / "a.png", FlatImage(1));
  dir_.Write("calib.yaml", TestCalibrationText());
  const auto even = OpenOrFail(Options());
  ASSERT_TRUE(even);
  EXPECT_EQ((*even->Next())->time, Timestamp(0));
  EXPECT_EQ((*even->Next())->time, FromSeconds(0.1));

  const TempDir named;
  WriteImage(named / "1403636584763555584.png", FlatImage(1));
  named.Write("calib.yaml", TestCalibrationText());
  ImageSourceOptions options;
  options.path = named.path().string();
  EXPECT_EQ((*OpenOrFail(options)->Next())->time.count(), 1403636584763555584);
}

TEST_F(LayoutsTest, NothingUsefulIsNamed) {
  EXPECT_THAT(OpenImageSource(Options()),
              StatusIs(StatusCode::kNotFound, HasSubstr("calibration")));
  dir_.Write("calib.yaml", TestCalibrationText());
  EXPECT_THAT(OpenImageSource(Options()), StatusIs(StatusCode::kNotFound, HasSubstr("no images")));
  ImageSourceOptions options = Options();
  options.path += "/none";
  EXPECT_THAT(OpenImageSource(options),
              StatusIs(StatusCode::kNotFound, HasSubstr("does not exist")));
}

TEST_F(LayoutsTest, BrokenListNamesItsLine) {
  WriteTestFolder(dir_, 2);
  dir_.Write("times.txt", "1.0 images/0.png\nsoon images/1.png\n");
  EXPECT_THAT(OpenImageSource(Options()),
              StatusIs(StatusCode::kInvalidArgument, HasSubstr("times.txt:2: 'soon'")));
  dir_.Write("times.txt", "1.0\n");
  EXPECT_THAT(OpenImageSource(Options()),
              StatusIs(StatusCode::kInvalidArgument, HasSubstr("times.txt:1:")));
}

TEST_F(LayoutsTest, OtherCalibrationFileIsUsedWhenGiven) {
  WriteTestFolder(dir_, 1);
  const TempDir other;
  ImageSourceOptions options = Options();
  options.calibration = other
                            .Write("mine.yaml",
                                   "image_width: 32\nimage_height: 24\ncamera_matrix: {data: [20, "
                                   "0, 16, 0, 20, 12, 0, 0, 1]}\n")
                            .string();
  EXPECT_EQ(OpenOrFail(options)->calibration().intrinsics.fx_px, 20);
  options.calibration += ".gone";
  EXPECT_THAT(OpenImageSource(options),
              StatusIs(StatusCode::kNotFound, HasSubstr("mine.yaml.gone")));
}

TEST_F(LayoutsTest, OdometryIsTakenPieceByPiece) {
  WriteTestFolder(dir_, 2);
  ImageSourceOptions options = Options();
  options.odometry =
      dir_.Write("wheels.csv", "99900000000,0,0,0\n100050000000,1,0,0\n100100000000,2,0,0\n")
          .string();
  const auto source = OpenOrFail(options);
  ASSERT_TRUE(source);
  EXPECT_EQ(source->TakeOdometry((*source->Next())->time).size(), 1u);
  EXPECT_EQ(source->TakeOdometry((*source->Next())->time).size(), 2u);
}

TEST_F(LayoutsTest, FixesBesideTheImagesAreTakenPieceByPiece) {
  WriteTestFolder(dir_, 2);
  dir_.Write("gnss.csv",
             "99000000000,47,8,400,1,2\n100000000000,47,8,400,1,2\n100050000000,47,8,401,1,2\n");
  ImageSourceOptions options = Options();
  options.gnss_antenna_in_camera_m = {1, 2, 3};
  const auto source = OpenOrFail(options);
  ASSERT_TRUE(source);
  EXPECT_TRUE(source->info().has_gnss);
  EXPECT_EQ(source->info().antenna_in_camera_m, Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(source->TakeGnss((*source->Next())->time).size(), 1u);
  EXPECT_EQ(source->TakeGnss((*source->Next())->time).size(), 1u);
  options.gnss = "none";
  EXPECT_FALSE(OpenOrFail(options)->info().has_gnss);
  options.gnss = (dir_.path() / "gone.csv").string();
  EXPECT_THAT(OpenImageSource(options), StatusIs(StatusCode::kNotFound, HasSubstr("gone.csv")));
  options.gnss =
      dir_.Write("bad.csv", "100000000000,47,8,400,1,2\n100050000000,97,8,401,1,2\n").string();
  EXPECT_THAT(OpenImageSource(options),
              StatusIs(StatusCode::kInvalidArgument, HasSubstr("bad.csv:2:")));
}

TEST_F(LayoutsTest, RangesAreTakenPieceByPiece) {
  WriteTestFolder(dir_, 2);
  dir_.Write("range0/sensor.yaml",
             "position_in_camera_m: [0, 0, 0]\ndirection_in_camera: [0, 0, 1]\n"
             "sigma_m: 0.01\nmin_range_m: 0.1\nmax_range_m: 50\n");
  dir_.Write("range0/data.csv", "99990000000,1\n100000000000,2\n100050000000,3\n");
  ImageSourceOptions options = Options();
  EXPECT_FALSE(OpenOrFail(options)->info().range_finder);
  options.range = (dir_.path() / "range0").string();
  const auto source = OpenOrFail(options);
  ASSERT_TRUE(source);
  ASSERT_TRUE(source->info().range_finder);
  EXPECT_EQ(source->info().range_finder->max_range_m, 50);
  EXPECT_EQ(source->TakeRanges((*source->Next())->time).size(), 2u);
  EXPECT_EQ(source->TakeRanges((*source->Next())->time).size(), 1u);
  dir_.Write("range0/data.csv", "99990000000,1\n100000000000,\n");
  EXPECT_THAT(OpenImageSource(options),
              StatusIs(StatusCode::kInvalidArgument, HasSubstr("data.csv:2:")));
  options.range = (dir_.path() / "gone").string();
  EXPECT_THAT(OpenImageSource(options), StatusIs(StatusCode::kNotFound, HasSubstr("gone")));
}

TEST_F(LayoutsTest, LayoutsWithoutImuOrSecondCameraSaySo) {
  WriteTestFolder(dir_, 1);
  ImageSourceOptions options = Options();
  options.stereo = true;
  EXPECT_THAT(OpenImageSource(options),
              StatusIs(StatusCode::kInvalidArgument, HasSubstr("stereo")));
  WriteKittiSequence("k/", "image_0");
  options = Options();
  options.path += "/k";
  options.imu = true;
  EXPECT_THAT(OpenImageSource(options), StatusIs(StatusCode::kInvalidArgument, HasSubstr("imu")));
}

}  // namespace
}  // namespace portolan
