#include "common/wire/geometry_wire.h"

#include <limits>

#include "tests/support/matchers.h"

namespace portolan {
namespace {

using testing::HasSubstr;

const Rigid3 kPose{Eigen::Quaterniond(0.5, 0.5, -0.5, 0.5), Eigen::Vector3d(1, -2, 3)};

TEST(GeometryWire, KeepsRigidMotions) {
  v1::Rigid3 message;
  ToProto(kPose, &message);
  const auto value = FromProto(message, "pose");
  ASSERT_THAT(value, IsOk());
  EXPECT_THAT(*value, NearRigid(kPose, 1e-12));
}

TEST(GeometryWire, KeepsSimilarities) {
  const Similarity3 similarity = Similarity3::FromRigid(kPose, 0.25);
  v1::Similarity3 message;
  ToProto(similarity, &message);
  const auto value = FromProto(message, "placement");
  ASSERT_THAT(value, IsOk());
  EXPECT_THAT(*value, NearSimilarity(similarity, 1e-12));
}

TEST(GeometryWire, RefusesBadScalesAndQuaternions) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  v1::Similarity3 message;
  for (const double scale : {0.0, -1.0, nan, std::numeric_limits<double>::infinity()}) {
    ToProto(Similarity3::FromRigid(kPose, scale), &message);
    EXPECT_THAT(FromProto(message, "placement"),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("placement: scale")));
  }
  ToProto(Similarity3::FromRigid(kPose), &message);
  message.mutable_rotation()->set_x(nan);
  EXPECT_THAT(FromProto(message, "placement"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("quaternion")));
  EXPECT_THAT(FromProto(v1::Rigid3(), "pose"), StatusIs(absl::StatusCode::kInvalidArgument));
}

TEST(GeometryWire, NormalisesQuaternionsThatAreAlmostUnit) {
  v1::Rigid3 message;
  ToProto(kPose, &message);
  message.mutable_rotation()->set_w(0.5005);
  const auto value = FromProto(message, "pose");
  ASSERT_THAT(value, IsOk());
  EXPECT_NEAR(value->rotation.norm(), 1.0, 1e-15);
}

CameraIntrinsics Camera() {
  CameraIntrinsics camera;
  camera.width_px = 752;
  camera.height_px = 480;
  camera.fx_px = 458.6;
  camera.fy_px = 457.3;
  camera.cx_px = 367.2;
  camera.cy_px = 248.4;
  camera.distortion = DistortionModel::kRadTan;
  camera.coefficients = {-0.28, 0.07, 0.0002, 1.7e-5, 0};
  return camera;
}

TEST(GeometryWire, KeepsCamerasExactly) {
  for (const auto model :
       {DistortionModel::kNone, DistortionModel::kRadTan, DistortionModel::kEquidistant}) {
    CameraIntrinsics camera = Camera();
    camera.distortion = model;
    v1::CameraCalibration message;
    ToProto(camera, &message);
    const auto value = FromProto(message, "camera");
    ASSERT_THAT(value, IsOk());
    EXPECT_EQ(*value, camera);
  }
}

TEST(GeometryWire, RefusesMalformedCameras) {
  const auto refuses = [](const char* what, auto damage) {
    v1::CameraCalibration message;
    ToProto(Camera(), &message);
    damage(&message);
    EXPECT_THAT(FromProto(message, "camera"),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(what)));
  };
  refuses("image size", [](auto* m) { m->set_width_px(0); });
  refuses("image size", [](auto* m) { m->set_height_px(4'000'000'000u); });
  refuses("focal", [](auto* m) { m->set_fx_px(-1); });
  refuses("principal", [](auto* m) { m->set_cy_px(std::nan("")); });
  refuses("distortion model", [](auto* m) { m->clear_distortion(); });
  refuses("exactly 5", [](auto* m) { m->add_coefficients(0); });
  refuses("coefficient", [](auto* m) { m->set_coefficients(4, std::nan("")); });
}

}  // namespace
}  // namespace portolan
