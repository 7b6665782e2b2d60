// The camera of the submaps that are made without images.
#ifndef PORTOLAN_TESTS_SUPPORT_SUBMAP_TEST_CAMERA_H_
#define PORTOLAN_TESTS_SUPPORT_SUBMAP_TEST_CAMERA_H_

#include "common/camera/camera_model.h"

namespace portolan {

// 640 x 480, 65 degrees wide, with a little distortion.
CameraIntrinsics SubmapTestCamera();

}  // namespace portolan

#endif  // PORTOLAN_TESTS_SUPPORT_SUBMAP_TEST_CAMERA_H_
