// Cameras of tests.
#ifndef PORTOLAN_TESTS_SUPPORT_TEST_CAMERAS_H_
#define PORTOLAN_TESTS_SUPPORT_TEST_CAMERAS_H_

#include "common/camera/camera_model.h"

namespace portolan {

// Of the submaps that are made without images: 640 x 480, 65 degrees wide, with a little
// distortion.
CameraIntrinsics SubmapTestCamera();

// 640 x 480, 500 px, no distortion, the principal point in the middle.
CameraModel PinholeTestCamera();

}  // namespace portolan

#endif  // PORTOLAN_TESTS_SUPPORT_TEST_CAMERAS_H_
