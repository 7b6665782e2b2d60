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

}  // namespace
}  // namespace portolan
