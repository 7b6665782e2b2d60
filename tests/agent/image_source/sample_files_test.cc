#include "agent/image_source/sample_files.h"

#include <numbers>

#include "tests/support/matchers.h"
#include "tests/support/temp_dir.h"

namespace portolan {
namespace {

using absl::StatusCode;
using testing::AllOf;
using testing::HasSubstr;

TEST(ReadImuCsv, ReadsEurocOrder) {
  const TempDir dir;
  const auto samples =
      ReadImuCsv(dir.Write("imu.csv", "#timestamp [ns],w...\n1000,0.1,0.2,0.3,1,2,9.8\n"));
  ASSERT_THAT(samples, IsOk());
  ASSERT_EQ(samples->size(), 1u);
  EXPECT_EQ(samples->front().time, Timestamp(1000));
  EXPECT_THAT(samples->front().gyro_rad_s, NearMatrix(Eigen::Vector3d(0.1, 0.2, 0.3), 0));
  EXPECT_THAT(samples->front().accel_m_s2, NearMatrix(Eigen::Vector3d(1, 2, 9.8), 0));
}

TEST(ReadImuCsv, NotANumberNamesTheLine) {
  const TempDir dir;
  const auto path = dir.Write("imu.csv", "#h\n1,0,0,0,0,0,9.8\n2,0,nan,0,0,0,9.8\n");
  EXPECT_THAT(ReadImuCsv(path), StatusIs(StatusCode::kInvalidArgument,
                                         AllOf(HasSubstr("imu.csv:3:"), HasSubstr("'nan'"))));
}

TEST(ReadImuCsv, BrokenLinesAreErrors) {
  const TempDir dir;
  for (const char* line : {"1,0,0,0,0,0", "x,0,0,0,0,0,9", "1,0,0,0,0,inf,9", "1,0,0,900,0,0,9",
                           "1,0,0,,0,0,9", "1,0,0,0,0,0,1e9"}) {
    EXPECT_THAT(ReadImuCsv(dir.Write("imu.csv", line)),
                StatusIs(StatusCode::kInvalidArgument, HasSubstr("imu.csv:1:")))
        << line;
  }
  EXPECT_THAT(ReadImuCsv(dir / "none.csv"), StatusIs(StatusCode::kNotFound));
}

TEST(ReadImuCsv, SortsAndKeepsRepeatedTimesOnce) {
  const TempDir dir;
  const auto samples = ReadImuCsv(
      dir.Write("imu.csv", "30,3,0,0,0,0,9\n10,1,0,0,0,0,9\n20,2,0,0,0,0,9\n20,7,0,0,0,0,9\n"));
  ASSERT_THAT(samples, IsOk());
  ASSERT_EQ(samples->size(), 3u);
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(samples->at(i).time, Timestamp(10 * (i + 1)));
    EXPECT_EQ(samples->at(i).gyro_rad_s.x(), i + 1);
  }
}

TEST(ReadOdometryCsv, ReadsPlanarAndSpatialPoses) {
  const TempDir dir;
  const auto samples = ReadOdometryCsv(
      dir.Write("odometry.csv", "10,1,2,1.5707963267948966\n20,1,2,3,0.5,0.5,0.5,0.5\n"));
  ASSERT_THAT(samples, IsOk());
  ASSERT_EQ(samples->size(), 2u);
  const Rigid3 planar{RotationExp({0, 0, std::numbers::pi / 2}), {1, 2, 0}};
  EXPECT_THAT(samples->at(0).odometry_from_body, NearRigid(planar, 1e-12));
  const Rigid3 spatial{Eigen::Quaterniond(0.5, 0.5, 0.5, 0.5), {1, 2, 3}};
  EXPECT_THAT(samples->at(1).odometry_from_body, NearRigid(spatial, 1e-12));
}

TEST(ReadOdometryCsv, BrokenLinesAreErrors) {
  const TempDir dir;
  for (const char* line : {"1,2,3", "1,2,3,4,5", "1,0,0,nan", "1,0,0,0,0,0,0,0"}) {
    EXPECT_THAT(ReadOdometryCsv(dir.Write("o.csv", line)),
                StatusIs(StatusCode::kInvalidArgument, HasSubstr("o.csv:1:")))
        << line;
  }
}

TEST(ReadGnssCsv, ReadsFixes) {
  const TempDir dir;
  const auto fixes = ReadGnssCsv(dir.Write(
      "gnss.csv",
      "# time_ns,lat,lon,height,sigma_h,sigma_v\n20,47.5,-8.25,400.5,1,2.5\n10,1,2,3,0.02,0.04\n"));
  ASSERT_THAT(fixes, IsOk());
  ASSERT_EQ(fixes->size(), 2u);
  EXPECT_EQ(fixes->at(0).time, Timestamp(10));
  EXPECT_EQ(fixes->at(1).position, (GeodeticPosition{47.5, -8.25, 400.5}));
  EXPECT_EQ(fixes->at(1).sigma_horizontal_m, 1);
  EXPECT_EQ(fixes->at(1).sigma_vertical_m, 2.5);
}

TEST(ReadGnssCsv, BrokenLinesAreErrors) {
  const TempDir dir;
  for (const char* line : {"1,47,8,400,1", "1,47,8,400,1,1,1", "1,97,8,400,1,1", "1,47,188,400,1,1",
                           "1,47,8,nan,1,1", "1,47,8,400,0,1", "1,47,8,400,1,-1"}) {
    EXPECT_THAT(ReadGnssCsv(dir.Write("g.csv", std::string("1,2,3,4,5,6\n") + line)),
                StatusIs(StatusCode::kInvalidArgument, HasSubstr("g.csv:2:")))
        << line;
  }
}

TEST(ReadRangeCsv, ReadsRangesWithAndWithoutTheirSigma) {
  const TempDir dir;
  const auto ranges = ReadRangeCsv(dir.Write("data.csv", "#time,range\n20,3.5\n10,0\n30,2,0.1\n"));
  ASSERT_THAT(ranges, IsOk());
  ASSERT_EQ(ranges->size(), 3u);
  EXPECT_EQ(ranges->at(0).range_m, 0);
  EXPECT_EQ(ranges->at(1).time, Timestamp(20));
  EXPECT_EQ(ranges->at(1).sigma_m, 0);
  EXPECT_EQ(ranges->at(2).sigma_m, 0.1);
}

TEST(ReadRangeCsv, BrokenLinesAreErrors) {
  const TempDir dir;
  for (const char* line : {"5", "5,1,1,1", "x,1", "5,nan", "5,inf", "5,1e9", "5,1,0", "5,1,-1"}) {
    EXPECT_THAT(ReadRangeCsv(dir.Write("r.csv", std::string("1,2\n") + line)),
                StatusIs(StatusCode::kInvalidArgument, HasSubstr("r.csv:2:")))
        << line;
  }
  EXPECT_THAT(ReadRangeCsv(dir / "none.csv"), StatusIs(StatusCode::kNotFound));
}

constexpr char kFinder[] =
    "position_in_camera_m: [0.1, -0.05, 0]\n"
    "direction_in_camera: [0, 0, 2]\n"
    "sigma_m: 0.02\nmin_range_m: 0.2\nmax_range_m: 40\n";

TEST(ReadRangeFinder, ReadsItsCalibration) {
  const TempDir dir;
  const auto finder = ReadRangeFinder(dir.Write("sensor.yaml", kFinder));
  ASSERT_THAT(finder, IsOk());
  EXPECT_THAT(finder->position_in_camera_m, NearMatrix(Eigen::Vector3d(0.1, -0.05, 0), 0));
  EXPECT_THAT(finder->direction_in_camera, NearMatrix(Eigen::Vector3d(0, 0, 1), 1e-15));
  EXPECT_EQ(finder->sigma_m, 0.02);
  EXPECT_EQ(finder->min_range_m, 0.2);
  EXPECT_EQ(finder->max_range_m, 40);
}

TEST(ReadRangeFinder, WrongValuesNameTheKey) {
  const TempDir dir;
  const std::vector<std::vector<std::string>> cases = {
      {"[0, 0, 2]", "[0, 0, 0]", "direction_in_camera"},
      {"[0, 0, 2]", "[0, 1]", "direction_in_camera"},
      {"[0, 0, 2]", "[0, .nan, 1]", "direction_in_camera"},
      {"0.1, -0.05", "1e6, 0", "position_in_camera_m"},
      {"position_in_camera_m", "position", "position_in_camera_m"},
      {"sigma_m: 0.02", "sigma_m: 0", "sigma_m"},
      {"min_range_m: 0.2", "min_range_m: -1", "min_range_m"},
      {"max_range_m: 40", "max_range_m: 0.1", "max_range_m"},
      {"max_range_m: 40", "max_range_m: far", "max_range_m"}};
  for (const auto& change : cases) {
    std::string text = kFinder;
    text.replace(text.find(change[0]), change[0].size(), change[1]);
    EXPECT_THAT(ReadRangeFinder(dir.Write("sensor.yaml", text)),
                StatusIs(StatusCode::kInvalidArgument,
                         AllOf(HasSubstr("sensor.yaml"), HasSubstr(change[2]))))
        << change[1];
  }
  EXPECT_THAT(ReadRangeFinder(dir / "none.yaml"), StatusIs(StatusCode::kNotFound));
}

}  // namespace
}  // namespace portolan
