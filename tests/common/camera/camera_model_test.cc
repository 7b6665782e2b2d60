#include "common/camera/camera_model.h"

#include <limits>
#include <numbers>
#include <opencv2/calib3d.hpp>
#include <random>

#include "tests/support/matchers.h"
#include "tests/support/numeric_derivative.h"

namespace portolan {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using testing::HasSubstr;

CameraIntrinsics Pinhole() { return {640, 480, 525.5, 525.5, 320, 240}; }
// The EuRoC cam0.
CameraIntrinsics RadTan() {
  return {752,
          480,
          458.654,
          457.296,
          367.215,
          248.375,
          DistortionModel::kRadTan,
          {-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05, 0}};
}
// A phone whose polynomial folds at about 48 degrees, outside of its image.
CameraIntrinsics FoldingRadTan() {
  return {640,
          480,
          525.060143,
          524.245488,
          308.649343,
          236.536006,
          DistortionModel::kRadTan,
          {0.10837057, -0.19197536, 0.001, -0.002, 0.01359737}};
}
// The 100 degree MonoSLAM lens.
CameraIntrinsics Fisheye() {
  return {320,
          240,
          195,
          195,
          162,
          125,
          DistortionModel::kEquidistant,
          {-0.00893224, -0.03290984, -0.00518532, 0.00190938, 0}};
}

CameraModel Make(const CameraIntrinsics& intrinsics) {
  return CameraModel::Create(intrinsics).value();
}

class CameraModelTest : public testing::TestWithParam<CameraIntrinsics> {
 protected:
  CameraModel camera_ = Make(GetParam());
};

TEST_P(CameraModelTest, UnprojectInvertsProjectOverTheWholeImage) {
  for (int y = 0; y < camera_.height_px(); y += 3) {
    for (int x = 0; x < camera_.width_px(); x += 3) {
      const Vector2d pixel(x, y);
      const auto bearing = camera_.Unproject(pixel);
      ASSERT_TRUE(bearing) << pixel.transpose();
      EXPECT_NEAR(bearing->norm(), 1, 1e-12);
      const auto back = camera_.Project(3.7 * *bearing);
      ASSERT_TRUE(back);
      ASSERT_THAT(*back, NearMatrix(pixel, 1e-7));
    }
  }
}

TEST_P(CameraModelTest, JacobianEqualsNumericDerivative) {
  std::mt19937 generator(3);
  std::uniform_real_distribution<double> x(-20, camera_.width_px() + 20);
  std::uniform_real_distribution<double> y(-20, camera_.height_px() + 20), depth(0.5, 20);
  for (int i = 0; i < 500; ++i) {
    const auto bearing = camera_.Unproject({x(generator), y(generator)});
    ASSERT_TRUE(bearing);
    const Vector3d point = depth(generator) * *bearing;
    Matrix23d analytic;
    ASSERT_TRUE(camera_.Project(point, &analytic));
    const Eigen::MatrixXd numeric = NumericJacobian(
        point, [&](const Eigen::VectorXd& p) { return camera_.Project(p).value(); },
        1e-3 * point.norm());
    EXPECT_THAT(analytic, NearMatrix(numeric, 1e-6 * camera_.mean_focal_px()));
  }
}

TEST_P(CameraModelTest, RadialDerivativeEqualsNumericDerivative) {
  std::mt19937 generator(5);
  std::uniform_real_distribution<double> x(0, camera_.width_px() - 1);
  std::uniform_real_distribution<double> y(0, camera_.height_px() - 1);
  for (int i = 0; i < 200; ++i) {
    const auto bearing = camera_.Unproject({x(generator), y(generator)});
    ASSERT_TRUE(bearing);
    const Vector3d point = 3 * *bearing;
    const Eigen::MatrixXd numeric = NumericJacobian(
        Eigen::VectorXd::Zero(2),
        [&](const Eigen::VectorXd& added) {
          return camera_.WithRadial(added.head<2>()).value().Project(point).value();
        },
        1e-4);
    EXPECT_THAT(camera_.DPixelDRadial(point), NearMatrix(numeric, 1e-6 * camera_.mean_focal_px()));
  }
  EXPECT_TRUE(camera_.DPixelDRadial({0.1, 0.2, -1}).isZero());
}

TEST_P(CameraModelTest, RadialDistortionThatFoldsIsRefused) {
  EXPECT_FALSE(camera_.WithRadial({-5, 0}).ok());
}

TEST_P(CameraModelTest, JacobianHoldsAtTheOpticalAxisAndTheCorners) {
  const double right = camera_.width_px() - 1, bottom = camera_.height_px() - 1;
  std::vector<Vector3d> points = {{0, 0, 2}, {1e-12, -2e-12, 2}, {1e-7, 1e-7, 2}, {1e-4, 0, 2}};
  for (const Vector2d& corner :
       {Vector2d(0, 0), Vector2d(right, 0), Vector2d(0, bottom), Vector2d(right, bottom)}) {
    points.push_back(4 * *camera_.Unproject(corner));
  }
  for (const Vector3d& point : points) {
    Matrix23d analytic;
    ASSERT_TRUE(camera_.Project(point, &analytic));
    const Eigen::MatrixXd numeric = NumericJacobian(
        point, [&](const Eigen::VectorXd& p) { return camera_.Project(p).value(); });
    EXPECT_THAT(analytic, NearMatrix(numeric, 1e-6 * camera_.mean_focal_px())) << point.transpose();
  }
}

TEST_P(CameraModelTest, NothingBehindTheCameraHasAnImage) {
  EXPECT_FALSE(camera_.Project({0, 0, -1}));
  EXPECT_FALSE(camera_.Project({0.1, 0.2, -3}));
  EXPECT_FALSE(camera_.Project({1, 1, 0}));
  EXPECT_FALSE(camera_.Project({0, 0, 0}));
  EXPECT_FALSE(camera_.Project(Vector3d::Constant(std::numeric_limits<double>::quiet_NaN())));
}

TEST_P(CameraModelTest, NotANumberHasNoBearing) {
  EXPECT_FALSE(camera_.Unproject({std::numeric_limits<double>::quiet_NaN(), 10}));
  EXPECT_FALSE(camera_.Unproject({10, std::numeric_limits<double>::infinity()}));
}

// The further out the ray, the further out the pixel: no ray outside of the view may land in the
// image a second time.
TEST_P(CameraModelTest, NoFalseImageOfRaysOutsideOfTheView) {
  const Vector2d centre(GetParam().cx_px, GetParam().cy_px);
  for (int direction = 0; direction < 36; ++direction) {
    const double azimuth = direction * std::numbers::pi / 18;
    double last = 0;
    for (double angle = 0.01; angle < 1.57; angle += 0.005) {
      const Vector3d ray(std::sin(angle) * std::cos(azimuth), std::sin(angle) * std::sin(azimuth),
                         std::cos(angle));
      const auto pixel = camera_.Project(ray);
      if (!pixel) break;
      const double radius = (*pixel - centre).norm();
      ASSERT_GT(radius, last) << "azimuth " << azimuth << " angle " << angle;
      last = radius;
    }
  }
}

TEST_P(CameraModelTest, UnprojectFarOutsideIsConsistentOrAbsent) {
  for (const Vector2d& pixel : {Vector2d(-5000, 3), Vector2d(1e5, 1e5), Vector2d(1e9, -1e9),
                                Vector2d(2000, 200), Vector2d(-300, -300)}) {
    const auto bearing = camera_.Unproject(pixel);
    if (!bearing) continue;
    const auto back = camera_.Project(*bearing);
    ASSERT_TRUE(back);
    EXPECT_LE((*back - pixel).norm(), 2e-6);
  }
}

std::string ModelName(const testing::TestParamInfo<CameraIntrinsics>& info) {
  const char* const names[] = {"Pinhole", "RadTan", "FoldingRadTan", "Fisheye"};
  return names[info.index];
}

INSTANTIATE_TEST_SUITE_P(Models, CameraModelTest,
                         testing::Values(Pinhole(), RadTan(), FoldingRadTan(), Fisheye()),
                         ModelName);

TEST(CameraModel, RadTanEqualsOpenCv) {
  CameraIntrinsics intrinsics = FoldingRadTan();
  const CameraModel camera = Make(intrinsics);
  const auto& k = intrinsics.coefficients;
  const cv::Matx33d matrix(intrinsics.fx_px, 0, intrinsics.cx_px, 0, intrinsics.fy_px,
                           intrinsics.cy_px, 0, 0, 1);
  const std::vector<cv::Point3d> points = {{0.3, -0.2, 1.1}, {-1, 0.7, 2.5}, {0, 0, 1}};
  std::vector<cv::Point2d> pixels;
  cv::projectPoints(points, cv::Vec3d(), cv::Vec3d(), matrix, cv::Vec<double, 5>(k.data()), pixels);
  for (size_t i = 0; i < points.size(); ++i) {
    EXPECT_THAT(camera.Project({points[i].x, points[i].y, points[i].z}).value(),
                NearMatrix(Vector2d(pixels[i].x, pixels[i].y), 1e-9));
  }
}

TEST(CameraModel, EquidistantEqualsOpenCvFisheye) {
  CameraIntrinsics intrinsics = Fisheye();
  const CameraModel camera = Make(intrinsics);
  const cv::Matx33d matrix(195, 0, 162, 0, 195, 125, 0, 0, 1);
  const std::vector<cv::Point3d> points = {{0.9, -0.4, 1.1}, {-1, 0.7, 0.9}, {0.001, 0, 1}};
  std::vector<cv::Point2d> pixels;
  cv::fisheye::projectPoints(points, pixels, cv::Vec3d(), cv::Vec3d(), matrix,
                             cv::Vec4d(intrinsics.coefficients.data()));
  for (size_t i = 0; i < points.size(); ++i) {
    EXPECT_THAT(camera.Project({points[i].x, points[i].y, points[i].z}).value(),
                NearMatrix(Vector2d(pixels[i].x, pixels[i].y), 1e-9));
  }
}

TEST(CameraModel, RayBeyondTheFoldHasNoImage) {
  const CameraModel camera = Make(FoldingRadTan());
  EXPECT_TRUE(camera.Project({1.0, 0, 1}));
  EXPECT_FALSE(camera.Project({1.3, 0, 1}));
  EXPECT_FALSE(camera.Project({5, 0, 1}));
}

TEST(CameraModel, WideFisheyeWithDarkCornersIsAccepted) {
  // 512 x 512, corners at 108 degrees: outside of the model, the rest is usable.
  const auto camera = CameraModel::Create({512,
                                           512,
                                           190.97,
                                           190.97,
                                           254.93,
                                           256.89,
                                           DistortionModel::kEquidistant,
                                           {0.00348239, 0.00071503, -0.00205324, 0.00020294, 0}});
  ASSERT_THAT(camera, IsOk());
  EXPECT_FALSE(camera->Unproject({0, 0}));
  EXPECT_TRUE(camera->Unproject({5, 256}));
}

TEST(CameraModel, CreateNamesTheBadField) {
  const auto expect_error = [](CameraIntrinsics intrinsics, const char* word) {
    EXPECT_THAT(CameraModel::Create(intrinsics),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(word)));
  };
  CameraIntrinsics bad = Pinhole();
  bad.width_px = 0;
  expect_error(bad, "width_px");
  bad = Pinhole();
  bad.fy_px = -1;
  expect_error(bad, "fy_px");
  bad = Pinhole();
  bad.cx_px = std::numeric_limits<double>::quiet_NaN();
  expect_error(bad, "cx_px");
  bad = RadTan();
  bad.coefficients[3] = std::numeric_limits<double>::infinity();
  expect_error(bad, "coefficient 3");
  bad = Pinhole();
  bad.distortion = static_cast<DistortionModel>(17);
  expect_error(bad, "distortion");
}

TEST(CameraModel, CreateRefusesDistortionThatFoldsInsideTheImage) {
  CameraIntrinsics bad = RadTan();
  bad.coefficients = {-0.6, 0, 0, 0, 0};
  EXPECT_THAT(CameraModel::Create(bad),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("not invertible")));
  bad = Fisheye();
  bad.coefficients = {-2, 0, 0, 0, 0};
  EXPECT_THAT(CameraModel::Create(bad),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("not invertible")));
}

TEST(CameraModel, IsInImageCountsPixelCentres) {
  const CameraModel camera = Make(Pinhole());
  EXPECT_TRUE(camera.IsInImage({0, 0}));
  EXPECT_TRUE(camera.IsInImage({639, 479}));
  EXPECT_FALSE(camera.IsInImage({639.1, 10}));
  EXPECT_FALSE(camera.IsInImage({-0.1, 10}));
  EXPECT_TRUE(camera.IsInImage({10, 10}, 10));
  EXPECT_FALSE(camera.IsInImage({9.9, 10}, 10));
  EXPECT_FALSE(camera.IsInImage({100, std::numeric_limits<double>::quiet_NaN()}));
}

}  // namespace
}  // namespace portolan
