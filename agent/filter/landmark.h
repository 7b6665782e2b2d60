// A landmark of the filter state: a ray with an inverse depth, or a Euclidean point. Derivations in
// README.md.
#ifndef PORTOLAN_AGENT_FILTER_LANDMARK_H_
#define PORTOLAN_AGENT_FILTER_LANDMARK_H_

#include <Eigen/Core>
#include <optional>

#include "common/base/strong_id.h"
#include "common/camera/camera_model.h"
#include "common/geometry/rigid3.h"

namespace portolan {

using Matrix26d = Eigen::Matrix<double, 2, 6>;

// Every landmark has a three-dimensional error:
//   ray:       [two small rotations of the ray; inverse depth], on top of its anchor's three
//   Euclidean: the point's coordinates.
// Ray: point = anchor + ray_frame.col(2) / inverse_depth (Civera, Davison, Montiel, T-RO 2008,
// Eq. 3). Instead of azimuth and elevation, which are singular at the poles, the ray's error turns
// it towards ray_frame.col(0) and col(1).
struct Landmark {
  TrackId track;
  bool euclidean = false;
  // Euclidean only.
  Eigen::Vector3d point_in_submap = Eigen::Vector3d::Zero();
  // Ray only; columns are two tangents and the unit ray, in the submap frame.
  Eigen::Matrix3d ray_frame = Eigen::Matrix3d::Identity();
  double inverse_depth = 0;
  // Number of the anchor in the state; only rays have one.
  int anchor = -1;
  // Number of this landmark's block in the error state.
  int block = -1;

  Eigen::Vector3d ray() const { return ray_frame.col(2); }
  // Adds an error.
  void Correct(const Eigen::Vector3d& error);
};

// A landmark in an image, with the derivatives of the pixel by the errors of the camera's pose
// (MotionModel's convention), of the landmark and of its anchor (zero for a Euclidean one).
struct LandmarkProjection {
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  Matrix26d d_pixel_d_camera = Matrix26d::Zero();
  Matrix23d d_pixel_d_landmark = Matrix23d::Zero();
  Matrix23d d_pixel_d_anchor = Matrix23d::Zero();
  // Rays only, else zero: d_pixel_d_anchor over the inverse depth.
  Matrix23d d_pixel_d_shift = Matrix23d::Zero();
};

// The direction in which a camera sees the landmark, not normalised: the point in the camera frame
// times the inverse depth for a ray, so that infinity needs no special case.
Eigen::Vector3d DirectionInCamera(const Landmark& landmark, const Eigen::Vector3d& anchor,
                                  const Rigid3& submap_from_camera);

// No value if the landmark is behind the camera or outside of the model's range; the pixel may lie
// outside of the image. Pass no projection derivatives (null) for the pixel alone.
std::optional<Eigen::Vector2d> ProjectLandmark(const Landmark& landmark,
                                               const Eigen::Vector3d& anchor,
                                               const Rigid3& submap_from_camera,
                                               const CameraModel& camera,
                                               LandmarkProjection* projection = nullptr);

// A new ray from the current camera through a pixel; inverse depth as given. No value if the pixel
// cannot be unprojected.
struct NewRay {
  Landmark landmark;
  // By the error of the camera's orientation and by the pixel; rows: the ray's two rotations.
  Matrix23d d_ray_d_orientation;
  Eigen::Matrix2d d_ray_d_pixel;
};
std::optional<NewRay> MakeRay(TrackId track, const Eigen::Vector2d& pixel, double inverse_depth,
                              const Eigen::Quaterniond& submap_from_camera,
                              const CameraModel& camera);

// The point of a ray and its derivatives by the ray's error; by the anchor's it is the identity.
Eigen::Vector3d PointOfRay(const Landmark& ray, const Eigen::Vector3d& anchor,
                           Eigen::Matrix3d* d_point_d_ray = nullptr);

// Linearity index of the depth seen from camera_position: 4 sigma_d / d1 |cos alpha| (Civera 2008,
// Eq. 34). Infinite while the depth is not positive.
double LinearityIndex(const Landmark& ray, const Eigen::Vector3d& anchor,
                      double inverse_depth_variance, const Eigen::Vector3d& camera_position);

// The same landmark in a new submap frame. A ray is anchored anew in the new frame's origin, which
// is exactly known; so afterwards no landmark has an anchor.
struct RebasedLandmark {
  Landmark landmark;
  // New error by the old errors.
  Eigen::Matrix<double, 3, 6> d_landmark_d_camera;
  Eigen::Matrix3d d_landmark_d_landmark;
  Eigen::Matrix3d d_landmark_d_anchor;
};
RebasedLandmark RebaseLandmark(const Landmark& landmark, const Eigen::Vector3d& anchor,
                               const Rigid3& submap_from_camera);

}  // namespace portolan

#endif  // PORTOLAN_AGENT_FILTER_LANDMARK_H_
