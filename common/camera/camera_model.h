// Pinhole cameras with radial-tangential (Brown-Conrady, OpenCV order) or equidistant fisheye
// (Kannala & Brandt, PAMI 2006, as in OpenCV's fisheye) distortion.
#ifndef PORTOLAN_COMMON_CAMERA_CAMERA_MODEL_H_
#define PORTOLAN_COMMON_CAMERA_CAMERA_MODEL_H_

#include <array>
#include <optional>

#include "common/base/status.h"
#include "common/geometry/rotation3.h"

namespace portolan {

enum class DistortionModel { kNone, kRadTan, kEquidistant };

// Plain numbers of a calibration, as read from a file or a message; unchecked.
struct CameraIntrinsics {
  int width_px = 0;
  int height_px = 0;
  double fx_px = 0, fy_px = 0, cx_px = 0, cy_px = 0;
  DistortionModel distortion = DistortionModel::kNone;
  // kRadTan: k1 k2 p1 p2 k3; kEquidistant: k1 k2 k3 k4 and 0. Unused ones are 0.
  std::array<double, 5> coefficients{};

  friend bool operator==(const CameraIntrinsics&, const CameraIntrinsics&) = default;
};

// A checked camera. Immutable value, thread-safe. Pixel (0, 0) is the centre of the top left
// pixel. Camera frame: x right, y down, z forward.
class CameraModel {
 public:
  // InvalidArgument, naming the field, if sizes are not positive, a number is not finite, a focal
  // length is not positive, or the distortion is not invertible over the image.
  static StatusOr<CameraModel> Create(const CameraIntrinsics& intrinsics);

  const CameraIntrinsics& intrinsics() const { return intrinsics_; }
  int width_px() const { return intrinsics_.width_px; }
  int height_px() const { return intrinsics_.height_px; }
  // Mean focal length; turns a pixel sigma at the centre into radians.
  double mean_focal_px() const { return 0.5 * (intrinsics_.fx_px + intrinsics_.fy_px); }

  // Projects a point (any length unit). No value if the point is behind the camera, or outside of
  // the region where the distortion polynomial is monotonic (such a pixel would be a false
  // image). The result may lie outside the image.
  std::optional<Eigen::Vector2d> Project(const Eigen::Vector3d& point_in_camera,
                                         Matrix23d* d_pixel_d_point_in_camera = nullptr) const;

  // Unit bearing of a pixel; no value if the iteration does not converge to a point that projects
  // back to within 1e-6 px.
  std::optional<Eigen::Vector3d> Unproject(const Eigen::Vector2d& pixel) const;

  // False if nobody has looked for the distortion, or images were rectified: all coefficients are
  // 0.
  bool has_distortion() const;

  // Derivative of a point's pixel by the first two radial coefficients, k1 and k2 of either
  // distortion model (of a camera without distortion: of kRadTan with all coefficients 0). Zero if
  // the point is not in front of the camera.
  Eigen::Matrix2d DPixelDRadial(const Eigen::Vector3d& point_in_camera) const;
  // The camera with these added to k1 and k2; InvalidArgument as Create has it.
  StatusOr<CameraModel> WithRadial(const Eigen::Vector2d& added) const;

  // True if the pixel lies inside the image and at least border_px from its edge.
  bool IsInImage(const Eigen::Vector2d& pixel, double border_px = 0.0) const;

 private:
  explicit CameraModel(const CameraIntrinsics& intrinsics) : intrinsics_(intrinsics) {}

  CameraIntrinsics intrinsics_;
  // kRadTan: largest r^2 of normalised coordinates, kEquidistant: largest angle in radians, for
  // which the distortion is monotonic.
  double valid_limit_ = 0;
};

}  // namespace portolan

#endif  // PORTOLAN_COMMON_CAMERA_CAMERA_MODEL_H_
