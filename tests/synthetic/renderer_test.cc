#include "tests/synthetic/renderer.h"

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/synthetic/mission.h"

namespace portolan::synthetic {
namespace {

constexpr double kSquare_m = 0.1;
constexpr int kColumns = 10, kRows = 8;

CameraModel MakeCamera(DistortionModel distortion) {
  CameraIntrinsics intrinsics = MissionOptions::EurocLikeCamera();
  intrinsics.distortion = distortion;
  if (distortion == DistortionModel::kEquidistant) {
    intrinsics.coefficients = {-0.02, 0.005, -0.003, 0.0007, 0};
  } else if (distortion == DistortionModel::kNone) {
    intrinsics.coefficients = {};
  }
  return *CameraModel::Create(intrinsics);
}

// A checkerboard that stands at x = 2 m, seen by a camera near the origin that looks along x.
World BoardWorld() {
  World world;
  Surface board;
  board.corner = {2.0, 0.5, 1.4};
  board.u = -Eigen::Vector3d::UnitY();
  board.v = -Eigen::Vector3d::UnitZ();
  board.width_m = kColumns * kSquare_m;
  board.height_m = kRows * kSquare_m;
  board.texture =
      std::make_shared<const Texture>(MakeCheckerboard(kColumns, kRows, kSquare_m, 0.004));
  world.surfaces.push_back(board);
  return world;
}

Rigid3 LookingAlongX(const Eigen::Vector3d& position, const Eigen::Vector3d& turn_rad) {
  Eigen::Matrix3d rotation;
  rotation << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  return {RotationExp(turn_rad) * Eigen::Quaterniond(rotation), position};
}

// Board corners found in the image against where the camera model puts them: the largest distance
// (aliasing) and the mean offset (bias).
struct CornerErrors {
  double largest_px = 0;
  double bias_px = 0;
};
CornerErrors MeasureCorners(const CameraModel& camera, const Rigid3& world_from_camera) {
  const World world = BoardWorld();
  Renderer renderer(camera, world);
  cv::Mat1f light;
  renderer.Render(world_from_camera, &light);
  cv::Mat1b image;
  light.convertTo(image, CV_8U);
  CornerErrors errors;
  cv::Point2f sum(0, 0);
  for (int row = 1; row < kRows; ++row) {
    for (int column = 1; column < kColumns; ++column) {
      const Surface& board = world.surfaces[0];
      const Eigen::Vector3d corner =
          board.corner + column * kSquare_m * board.u + row * kSquare_m * board.v;
      const auto pixel = camera.Project(world_from_camera.Inverse() * corner);
      if (!pixel || !camera.IsInImage(*pixel, 12)) return {1e9, 1e9};
      const cv::Point2f expected(static_cast<float>(pixel->x()), static_cast<float>(pixel->y()));
      std::vector<cv::Point2f> found = {expected + cv::Point2f(1.0f, -1.0f)};
      cv::cornerSubPix(image, found, {5, 5}, {-1, -1},
                       cv::TermCriteria(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 50, 1e-4));
      errors.largest_px = std::max(errors.largest_px, cv::norm(found[0] - expected));
      sum += found[0] - expected;
    }
  }
  errors.bias_px = cv::norm(sum) / ((kRows - 1) * (kColumns - 1));
  return errors;
}

TEST(Renderer, PutsCornersWhereTheCameraModelDoes) {
  for (const auto distortion :
       {DistortionModel::kNone, DistortionModel::kRadTan, DistortionModel::kEquidistant}) {
    const CameraModel camera = MakeCamera(distortion);
    for (const Rigid3& pose :
         {LookingAlongX({0, 0, 1}, {0, 0, 0}), LookingAlongX({0.3, 0.4, 1.2}, {0.2, 0.1, -0.3})}) {
      const CornerErrors errors = MeasureCorners(camera, pose);
      EXPECT_LT(errors.largest_px, 0.2);
      EXPECT_LT(errors.bias_px, 0.06);
    }
  }
}

TEST(Renderer, DepthIsThatOfThePlane) {
  const World world = BoardWorld();
  Renderer renderer(MakeCamera(DistortionModel::kRadTan), world);
  cv::Mat1f light;
  renderer.Render(LookingAlongX({0.5, 0, 1}, {0, 0, 0}), &light);
  const cv::Mat1f depth = renderer.Depth();
  EXPECT_NEAR(depth(240, 370), 1.5, 1e-5);
  EXPECT_NEAR(depth(200, 300), 1.5, 1e-5);
  EXPECT_EQ(depth(5, 5), 0);
  EXPECT_FLOAT_EQ(light(5, 5), static_cast<float>(world.background));
}

TEST(Renderer, NearThingsHideFarThings) {
  World world = BoardWorld();
  const auto texture = std::make_shared<const Texture>(cv::Mat1b(8, 8, uint8_t{100}), 0.1, false);
  AddBox({{1.2, 0, 0.8}, {0.2, 0.2, 0.4}, 0.3}, {texture}, &world);
  Renderer renderer(MakeCamera(DistortionModel::kRadTan), world);
  cv::Mat1f light;
  renderer.Render(LookingAlongX({0, 0, 1}, {0, 0, 0}), &light);
  EXPECT_LT(renderer.Depth()(248, 367), 1.2);
  EXPECT_NEAR(renderer.Depth()(248, 467), 2.0, 1e-5);
}

TEST(Renderer, SurfacesHaveOneSide) {
  const World world = BoardWorld();
  Renderer renderer(MakeCamera(DistortionModel::kRadTan), world);
  cv::Mat1f light;
  renderer.Render(LookingAlongX({4, 0, 1}, {0, 0, M_PI}), &light);
  EXPECT_EQ(cv::countNonZero(renderer.Depth()), 0);
}

// Edges are blended: along the board's slanted border there are grey values between the board's
// own and the background.
TEST(Renderer, SmoothsEdges) {
  const World world = BoardWorld();
  Renderer renderer(MakeCamera(DistortionModel::kNone), world);
  cv::Mat1f light;
  renderer.Render(LookingAlongX({0, 0, 1}, {0.1, 0, 0}), &light);
  int between = 0;
  for (const float grey : light.row(120)) between += grey > 60 && grey < 170 ? 1 : 0;
  for (const float grey : light.row(248)) between += grey > 60 && grey < 170 ? 1 : 0;
  EXPECT_GT(between, 5);
}

}  // namespace
}  // namespace portolan::synthetic
