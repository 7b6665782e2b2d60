#include "tests/synthetic/euroc_writer.h"

#include <fstream>
#include <opencv2/imgcodecs.hpp>

#include "agent/image_source/image_source.h"
#include "agent/image_source/sample_files.h"
#include "common/camera/calibration.h"
#include "common/trajectory/trajectory_io.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/support/matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/synthetic/frame_renderer.h"

namespace portolan::synthetic {
namespace {

Mission ShortMission() {
  MissionOptions options;
  options.name = "three_agents";
  options.frames = 3;
  return *MakeMission(options);
}

EurocWriterOptions Png() {
  EurocWriterOptions options;
  options.image_format = "png";
  return options;
}

TEST(WriteEurocAgent, OwnReadersReadItBack) {
  const TempDir dir;
  const Mission mission = ShortMission();
  ASSERT_THAT(WriteEurocAgent(mission, 2, dir.path().string(), Png()), IsOk());
  const auto mav = dir / "agent2/mav0";
  const auto camera = ReadCameraCalibration(mav / "cam0/sensor.yaml");
  ASSERT_THAT(camera, IsOk());
  EXPECT_EQ(camera->intrinsics, mission.options.camera);
  EXPECT_THAT(*camera->body_from_camera, NearRigid(mission.body_from_camera, 1e-9));
  EXPECT_THAT(ReadImuCalibration(mav / "imu0/sensor.yaml"), IsOk());
  const auto truth = ReadEurocGroundTruth((mav / "state_groundtruth_estimate0/data.csv").string());
  ASSERT_THAT(truth, IsOk());
  const auto camera_truth = ReadTumTrajectory((dir / "agent2/groundtruth.txt").string());
  ASSERT_THAT(camera_truth, IsOk());
  ASSERT_EQ(camera_truth->size(), 3u);
  // The body's ground truth at 200 Hz and the camera's at the image times are one motion.
  for (const StampedPose& pose : *camera_truth) {
    const auto body = InterpolatePose(*truth, pose.time);
    ASSERT_TRUE(body);
    EXPECT_THAT(*body * mission.body_from_camera, NearRigid(pose.world_from_body, 1e-6));
  }
}

TEST(WriteEurocAgent, TheAgentsImageSourceReadsItBack) {
  const TempDir dir;
  const Mission mission = ShortMission();
  ASSERT_THAT(WriteEurocAgent(mission, 1, dir.path().string(), Png()), IsOk());
  ImageSourceOptions options;
  options.path = (dir / "agent1").string();
  options.imu = true;
  auto source = OpenImageSource(options);
  ASSERT_THAT(source, IsOk());
  EXPECT_EQ((*source)->info().type, ImageSourceType::kEuroc);
  FrameRenderer renderer(mission, 1);
  for (int i = 0; i < 3; ++i) {
    const auto frame = (*source)->Next();
    ASSERT_THAT(frame, IsOk());
    ASSERT_TRUE(frame->has_value());
    cv::Mat1b expected;
    renderer.Render(i, &expected);
    EXPECT_EQ((*frame)->time, mission.FrameTime(i));
    EXPECT_EQ(cv::norm((*frame)->gray, expected, cv::NORM_INF), 0);
  }
  EXPECT_EQ((*source)->TakeImu(mission.FrameTime(2)).size(), 21u);
}

TEST(WriteEurocAgent, ListsTheImagesItWrote) {
  const TempDir dir;
  const Mission mission = ShortMission();
  ASSERT_THAT(WriteEurocAgent(mission, 0, dir.path().string(), Png()), IsOk());
  const auto cam = dir / "agent0/mav0/cam0";
  std::ifstream list(cam / "data.csv");
  std::string header, line;
  std::getline(list, header);
  EXPECT_EQ(header, "#timestamp [ns],filename");
  FrameRenderer renderer(mission, 0);
  for (int frame = 0; frame < 3; ++frame) {
    ASSERT_TRUE(std::getline(list, line));
    const std::string stamp = std::to_string(mission.FrameTime(frame).count());
    EXPECT_EQ(line, stamp + "," + stamp + ".png");
    const cv::Mat image =
        cv::imread((cam / "data" / (stamp + ".png")).string(), cv::IMREAD_UNCHANGED);
    cv::Mat1b expected;
    renderer.Render(frame, &expected);
    ASSERT_EQ(image.type(), CV_8UC1);
    EXPECT_EQ(cv::norm(image, expected, cv::NORM_INF), 0);
  }
  EXPECT_FALSE(std::getline(list, line));
}

TEST(WriteEurocAgent, ReportsWhatItCannotWrite) {
  const TempDir dir;
  const auto file = dir.Write("file", "in the way");
  EXPECT_FALSE(WriteEurocAgent(ShortMission(), 0, file.string(), Png()).ok());
  EurocWriterOptions options;
  options.image_format = "bmp";
  EXPECT_THAT(WriteEurocAgent(ShortMission(), 0, dir.path().string(), options),
              StatusIs(absl::StatusCode::kInvalidArgument, testing::HasSubstr("png, jpg, pgm")));
}

TEST(WriteEurocAgent, RangesAreThoseOfTheHall) {
  const TempDir dir;
  Mission mission = ShortMission();
  mission.options.range_rate_hz = 50;
  ASSERT_THAT(WriteEurocAgent(mission, 0, dir.path().string(), Png()), IsOk());
  const auto folder = dir / "agent0/mav0/range0";
  const auto finder = ReadRangeFinder(folder / "sensor.yaml");
  ASSERT_THAT(finder, IsOk());
  const auto ranges = ReadRangeCsv(folder / "data.csv");
  ASSERT_THAT(ranges, IsOk());
  ASSERT_GE(ranges->size(), 4u);
  // The renderer's depth at the pixel where the range ends is that of the range.
  FrameRenderer renderer(mission, 0);
  cv::Mat1f light;
  renderer.RenderLight(0, &light);
  const auto camera = *CameraModel::Create(mission.options.camera);
  const Eigen::Vector3d point =
      finder->position_in_camera_m + ranges->front().range_m * finder->direction_in_camera;
  const Eigen::Vector2d pixel = *camera.Project(point);
  const double depth =
      renderer.Depth()(static_cast<int>(pixel.y() + 0.5), static_cast<int>(pixel.x() + 0.5));
  EXPECT_NEAR(point.z(), depth, 0.1);
}

}  // namespace
}  // namespace portolan::synthetic
