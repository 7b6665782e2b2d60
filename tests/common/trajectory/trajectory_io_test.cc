#include "common/trajectory/trajectory_io.h"

#include <sstream>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/support/matchers.h"
#include "tests/support/temp_dir.h"

namespace portolan {
namespace {

using testing::HasSubstr;
using testing::StartsWith;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

StatusOr<Trajectory> ParseTum(const std::string& text) {
  std::istringstream input(text);
  return ParseTumTrajectory(input, "a.txt");
}

StatusOr<Trajectory> ParseEuroc(const std::string& text) {
  std::istringstream input(text);
  return ParseEurocGroundTruth(input, "gt.csv");
}

StatusOr<Trajectory> ParseKitti(const std::string& text, const std::vector<Timestamp>& times) {
  std::istringstream input(text);
  return ParseKittiTrajectory(input, "00.txt", times);
}

Trajectory SampleTrajectory() {
  Trajectory trajectory;
  for (int i = 0; i < 20; ++i) {
    trajectory.push_back({Timestamp(1403636584763555584 + i * 50000003LL),
                          {RotationExp({0.1 * i, -0.05 * i, 0.3}), {1.5 * i, -2.25, 1e-5 * i}}});
  }
  return trajectory;
}

void ExpectSame(const Trajectory& actual, const Trajectory& expected) {
  ASSERT_EQ(actual.size(), expected.size());
  for (size_t i = 0; i < actual.size(); ++i) {
    EXPECT_EQ(actual[i].time, expected[i].time);
    EXPECT_THAT(actual[i].world_from_body, NearRigid(expected[i].world_from_body, 1e-8));
  }
}

TEST(ParseSeconds, KeepsNanosecondsOfLargeTimes) {
  EXPECT_EQ(ParseSeconds("1403636584.763555584")->count(), 1403636584763555584);
  EXPECT_EQ(ParseSeconds("0.5")->count(), 500000000);
  EXPECT_EQ(ParseSeconds("-1.25")->count(), -1250000000);
  EXPECT_EQ(ParseSeconds("3")->count(), 3000000000);
  EXPECT_EQ(ParseSeconds("1e-3")->count(), 1000000);
  EXPECT_EQ(ParseSeconds("0.0000000016")->count(), 2);
}

TEST(ParseSeconds, RejectsWhatIsNoTime) {
  for (const char* text : {"", "abc", "1.2.3", "nan", "inf", "1e20", "0x10", "-"}) {
    EXPECT_THAT(ParseSeconds(text), StatusIs(kInvalid)) << text;
  }
}

TEST(FormatSeconds, RoundTrips) {
  for (const int64_t count : {0L, 1L, -1L, 1403636584763555584L, -1250000000L}) {
    EXPECT_EQ(ParseSeconds(FormatSeconds(Timestamp(count)))->count(), count);
  }
  EXPECT_EQ(FormatSeconds(Timestamp(-1)), "-0.000000001");
}

TEST(TumFiles, RoundTrip) {
  const TempDir dir;
  const std::string path = (dir / "a.txt").string();
  ASSERT_THAT(WriteTumTrajectory(SampleTrajectory(), path), IsOk());
  const auto read = ReadTrajectory(path);
  ASSERT_THAT(read, IsOk());
  ExpectSame(*read, SampleTrajectory());
}

TEST(TumFiles, ReadHandTypedLines) {
  const auto trajectory = ParseTum("# comment\n\n1.5  1 2 3\t0 0 0.70710678 0.70710678\r\n");
  ASSERT_THAT(trajectory, IsOk());
  ASSERT_EQ(trajectory->size(), 1u);
  const Rigid3& pose = trajectory->front().world_from_body;
  EXPECT_THAT(pose.translation, NearMatrix(Eigen::Vector3d(1, 2, 3), 0.0));
  EXPECT_THAT(pose * Eigen::Vector3d(1, 0, 0), NearMatrix(Eigen::Vector3d(1, 3, 3), 1e-12));
}

TEST(TumFiles, ErrorsNameFileAndLine) {
  EXPECT_THAT(ParseTum("# c\n1 0 0 0 0 0 0\n"), StatusIs(kInvalid, StartsWith("a.txt:2: ")));
  EXPECT_THAT(ParseTum("1 0 0 0 0 0 0 1 9\n"), StatusIs(kInvalid, HasSubstr("found 9")));
  EXPECT_THAT(ParseTum("1 0 0 0 0 0 0 1\n2 x 0 0 0 0 0 1\n"),
              StatusIs(kInvalid, HasSubstr("a.txt:2: field 2 is not a finite number: 'x'")));
  EXPECT_THAT(ParseTum("1 0 inf 0 0 0 0 1\n"), StatusIs(kInvalid, HasSubstr("field 3")));
  EXPECT_THAT(ParseTum("1 0 0 0 0 0 0 2\n"), StatusIs(kInvalid, HasSubstr("norm")));
  EXPECT_THAT(ParseTum("2 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n"),
              StatusIs(kInvalid, HasSubstr("a.txt:2: time does not ascend")));
  EXPECT_THAT(ParseTum("t 0 0 0 0 0 0 1\n"), StatusIs(kInvalid, HasSubstr("a.txt:1: not a time")));
}

TEST(TumFiles, MissingFileIsNotFound) {
  EXPECT_THAT(ReadTrajectory("no/such/file.txt"),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("no/such/file.txt")));
  EXPECT_THAT(WriteTumTrajectory({}, "no/such/folder/file.txt"),
              StatusIs(absl::StatusCode::kPermissionDenied));
}

TEST(EurocFiles, ReadPublishedColumns) {
  const auto trajectory = ParseEuroc(
      "#timestamp, p_RS_R_x [m], ...\n"
      "1403636580838555648,4.688319,-1.786938,0.783338,0.534108,-0.153029,-0.827383,-0.082152,"
      "-0.027876,0.033207,0.800006,-0.003172,0.021267,0.078502,-0.025266,0.136696,0.075593\n");
  ASSERT_THAT(trajectory, IsOk());
  ASSERT_EQ(trajectory->size(), 1u);
  EXPECT_EQ(trajectory->front().time.count(), 1403636580838555648);
  const Rigid3& pose = trajectory->front().world_from_body;
  EXPECT_DOUBLE_EQ(pose.translation.z(), 0.783338);
  EXPECT_NEAR(pose.rotation.w(), 0.534108, 1e-5);
  EXPECT_NEAR(pose.rotation.y(), -0.827383, 1e-5);
}

TEST(EurocFiles, ErrorsNameFileAndLine) {
  EXPECT_THAT(ParseEuroc("#c\n1.5,0,0,0,1,0,0,0\n"),
              StatusIs(kInvalid, StartsWith("gt.csv:2: not a time in nanoseconds")));
  EXPECT_THAT(ParseEuroc("1,0,0,0,1,0,0\n"), StatusIs(kInvalid, HasSubstr("found 7")));
  EXPECT_THAT(ParseEuroc("1,0,0,,1,0,0,0\n"), StatusIs(kInvalid, HasSubstr("field 4")));
}

TEST(EurocFiles, AreRecognisedByTheirCommas) {
  const TempDir dir;
  const std::string path = dir.Write("data.csv", "#c\n7,1,2,3,1,0,0,0\n").string();
  const auto trajectory = ReadTrajectory(path);
  ASSERT_THAT(trajectory, IsOk());
  EXPECT_EQ(trajectory->front().time.count(), 7);
}

TEST(KittiFiles, RoundTrip) {
  const TempDir dir;
  const std::string poses = (dir / "poses.txt").string(), times = (dir / "times.txt").string();
  ASSERT_THAT(WriteKittiTrajectory(SampleTrajectory(), poses, times), IsOk());
  const auto read = ReadKittiTrajectory(poses, times);
  ASSERT_THAT(read, IsOk());
  ExpectSame(*read, SampleTrajectory());
}

TEST(KittiFiles, ErrorsNameFileAndLine) {
  const std::vector<Timestamp> one = {Timestamp(0)};
  const std::string identity = "1 0 0 0 0 1 0 0 0 0 1 0\n";
  EXPECT_THAT(ParseKitti(identity, one), IsOk());
  EXPECT_THAT(ParseKitti(identity + identity, one),
              StatusIs(kInvalid, HasSubstr("00.txt:2: more poses than times")));
  EXPECT_THAT(ParseKitti("", one), StatusIs(kInvalid, HasSubstr("fewer poses (0) than times (1)")));
  EXPECT_THAT(ParseKitti("1 0 0 0 0 1 0 0 0 0 2 0\n", one),
              StatusIs(kInvalid, HasSubstr("00.txt:1: the left 3x3 block is not a rotation")));
  EXPECT_THAT(ParseKitti("1 0 0 0 0 1 0 0 0 0 -1 0\n", one), StatusIs(kInvalid));
  EXPECT_THAT(ParseKitti("1 0 0\n", one), StatusIs(kInvalid, HasSubstr("expected 12 fields")));
}

TEST(ParseTimes, ReadsTheFirstField) {
  std::istringstream input("# t name\n0.000000 images/a.jpg\n0.033333 images/b.jpg\n");
  const auto times = ParseTimes(input, "times.txt");
  ASSERT_THAT(times, IsOk());
  EXPECT_THAT(*times, testing::ElementsAre(Timestamp(0), Timestamp(33333000)));
}

}  // namespace
}  // namespace portolan
