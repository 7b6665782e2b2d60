#include "tests/support/test_cameras.h"

namespace portolan {

CameraIntrinsics SubmapTestCamera() {
  CameraIntrinsics intrinsics;
  intrinsics.width_px = 640;
  intrinsics.height_px = 480;
  intrinsics.fx_px = 500;
  intrinsics.fy_px = 505;
  intrinsics.cx_px = 322;
  intrinsics.cy_px = 238;
  intrinsics.distortion = DistortionModel::kRadTan;
  intrinsics.coefficients = {-0.1, 0.02, 0.0005, -0.0004, 0};
  return intrinsics;
}

CameraModel PinholeTestCamera() {
  CameraIntrinsics intrinsics;
  intrinsics.width_px = 640;
  intrinsics.height_px = 480;
  intrinsics.fx_px = intrinsics.fy_px = 500;
  intrinsics.cx_px = 320;
  intrinsics.cy_px = 240;
  return CameraModel::Create(intrinsics).value();
}

}  // namespace portolan
