#include "agent/filter/landmark.h"

#include <Eigen/LU>
#include <cmath>
#include <limits>

namespace portolan {
namespace {

// Two unit vectors that complete `direction` to a right-handed frame with it as third axis.
Eigen::Matrix3d FrameAlong(const Eigen::Vector3d& direction) {
  Eigen::Matrix3d frame;
  frame.col(2) = direction.normalized();
  const Eigen::Vector3d helper =
      std::abs(frame(0, 2)) < 0.7 ? Eigen::Vector3d::UnitX() : Eigen::Vector3d::UnitY();
  frame.col(1) = frame.col(2).cross(helper).normalized();
  frame.col(0) = frame.col(1).cross(frame.col(2));
  return frame;
}

}  // namespace

void Landmark::Correct(const Eigen::Vector3d& error) {
  if (euclidean) {
    point_in_submap += error;
    return;
  }
  // Exp((-b, a, 0)) turns the third axis by a towards the first and by b towards the second.
  ray_frame = ray_frame * RotationExp(Eigen::Vector3d(-error(1), error(0), 0)).toRotationMatrix();
  inverse_depth += error(2);
}

Eigen::Vector3d DirectionInCamera(const Landmark& landmark, const Eigen::Vector3d& anchor,
                                  const Rigid3& submap_from_camera) {
  const Eigen::Vector3d& position = submap_from_camera.translation;
  const Eigen::Vector3d in_submap =
      landmark.euclidean
          ? Eigen::Vector3d(landmark.point_in_submap - position)
          : Eigen::Vector3d(landmark.inverse_depth * (anchor - position) + landmark.ray());
  return submap_from_camera.rotation.conjugate() * in_submap;
}

std::optional<Eigen::Vector2d> ProjectLandmark(const Landmark& landmark,
                                               const Eigen::Vector3d& anchor,
                                               const Rigid3& submap_from_camera,
                                               const CameraModel& camera,
                                               LandmarkProjection* projection) {
  const Eigen::Vector3d direction = DirectionInCamera(landmark, anchor, submap_from_camera);
  if (projection == nullptr) return camera.Project(direction);

  Matrix23d d_pixel_d_direction;
  const auto pixel = camera.Project(direction, &d_pixel_d_direction);
  if (!pixel.has_value()) return std::nullopt;
  const Matrix23d d_pixel_d_submap =
      d_pixel_d_direction * submap_from_camera.rotation.toRotationMatrix().transpose();
  projection->pixel = *pixel;
  projection->d_pixel_d_camera.rightCols<3>() = d_pixel_d_direction * Skew(direction);
  if (landmark.euclidean) {
    projection->d_pixel_d_camera.leftCols<3>() = -d_pixel_d_submap;
    projection->d_pixel_d_landmark = d_pixel_d_submap;
    projection->d_pixel_d_anchor.setZero();
    projection->d_pixel_d_shift.setZero();
    return pixel;
  }
  projection->d_pixel_d_shift = d_pixel_d_submap;
  projection->d_pixel_d_anchor = landmark.inverse_depth * d_pixel_d_submap;
  projection->d_pixel_d_camera.leftCols<3>() = -projection->d_pixel_d_anchor;
  projection->d_pixel_d_landmark.leftCols<2>() =
      d_pixel_d_submap * landmark.ray_frame.leftCols<2>();
  projection->d_pixel_d_landmark.col(2) =
      d_pixel_d_submap * (anchor - submap_from_camera.translation);
  return pixel;
}

std::optional<NewRay> MakeRay(TrackId track, const Eigen::Vector2d& pixel, double inverse_depth,
                              const Eigen::Quaterniond& submap_from_camera,
                              const CameraModel& camera) {
  const auto bearing = camera.Unproject(pixel);
  if (!bearing.has_value()) return std::nullopt;
  Matrix23d d_pixel_d_bearing;
  if (!camera.Project(*bearing, &d_pixel_d_bearing).has_value()) return std::nullopt;
  const Eigen::Matrix3d frame = FrameAlong(*bearing);

  NewRay ray;
  ray.landmark.track = track;
  ray.landmark.inverse_depth = inverse_depth;
  ray.landmark.ray_frame = submap_from_camera.toRotationMatrix() * frame;
  ray.d_ray_d_orientation = -(frame.leftCols<2>().transpose() * Skew(*bearing));
  const Eigen::Matrix2d d_pixel_d_ray = d_pixel_d_bearing * frame.leftCols<2>();
  if (std::abs(d_pixel_d_ray.determinant()) < 1e-9) return std::nullopt;
  ray.d_ray_d_pixel = d_pixel_d_ray.inverse();
  return ray;
}

Eigen::Vector3d PointOfRay(const Landmark& ray, const Eigen::Vector3d& anchor,
                           Eigen::Matrix3d* d_point_d_ray) {
  const double depth = 1.0 / ray.inverse_depth;
  if (d_point_d_ray != nullptr) {
    d_point_d_ray->leftCols<2>() = depth * ray.ray_frame.leftCols<2>();
    d_point_d_ray->col(2) = -(depth * depth) * ray.ray();
  }
  return anchor + depth * ray.ray();
}

double LinearityIndex(const Landmark& ray, const Eigen::Vector3d& anchor,
                      double inverse_depth_variance, const Eigen::Vector3d& camera_position) {
  if (ray.inverse_depth <= 0) return std::numeric_limits<double>::infinity();
  const Eigen::Vector3d from_camera = PointOfRay(ray, anchor) - camera_position;
  const double distance = from_camera.norm();
  const double depth_sigma =
      std::sqrt(inverse_depth_variance) / (ray.inverse_depth * ray.inverse_depth);
  const double cos_alpha = ray.ray().dot(from_camera) / distance;
  return 4 * depth_sigma / distance * std::abs(cos_alpha);
}

namespace {

RebasedLandmark RebaseEuclidean(const Landmark& landmark, const Rigid3& submap_from_camera) {
  RebasedLandmark rebased;
  rebased.landmark = landmark;
  rebased.landmark.point_in_submap = submap_from_camera.Inverse() * landmark.point_in_submap;
  const Eigen::Matrix3d new_from_old = submap_from_camera.rotation.toRotationMatrix().transpose();
  rebased.d_landmark_d_camera.leftCols<3>() = -new_from_old;
  rebased.d_landmark_d_camera.rightCols<3>() = Skew(rebased.landmark.point_in_submap);
  rebased.d_landmark_d_landmark = new_from_old;
  rebased.d_landmark_d_anchor.setZero();
  return rebased;
}

}  // namespace

RebasedLandmark RebaseLandmark(const Landmark& landmark, const Eigen::Vector3d& anchor,
                               const Rigid3& submap_from_camera) {
  if (landmark.euclidean) return RebaseEuclidean(landmark, submap_from_camera);
  // d = R'(rho (a - p) + m) is the new point times rho: new ray d / |d|, new rho' = rho / |d|.
  const Eigen::Vector3d direction = DirectionInCamera(landmark, anchor, submap_from_camera);
  const double norm = direction.norm();
  const Eigen::Matrix3d new_from_old = submap_from_camera.rotation.toRotationMatrix().transpose();

  RebasedLandmark rebased;
  rebased.landmark = landmark;
  rebased.landmark.anchor = -1;
  rebased.landmark.ray_frame = FrameAlong(direction);
  rebased.landmark.inverse_depth = landmark.inverse_depth / norm;

  // By d: the tangents over |d|; rho' falls with the length of d.
  Eigen::Matrix3d d_new_d_direction;
  d_new_d_direction.topRows<2>() = rebased.landmark.ray_frame.leftCols<2>().transpose() / norm;
  d_new_d_direction.row(2) =
      -(rebased.landmark.inverse_depth / norm) * rebased.landmark.ray().transpose();

  const Eigen::Matrix3d d_new_d_submap = d_new_d_direction * new_from_old;
  rebased.d_landmark_d_anchor = landmark.inverse_depth * d_new_d_submap;
  rebased.d_landmark_d_camera.leftCols<3>() = -rebased.d_landmark_d_anchor;
  rebased.d_landmark_d_camera.rightCols<3>() = d_new_d_direction * Skew(direction);
  rebased.d_landmark_d_landmark.leftCols<2>() = d_new_d_submap * landmark.ray_frame.leftCols<2>();
  rebased.d_landmark_d_landmark.col(2) = d_new_d_submap * (anchor - submap_from_camera.translation);
  rebased.d_landmark_d_landmark(2, 2) += 1.0 / norm;
  return rebased;
}

}  // namespace portolan
