#include "common/geometry/rotation3.h"

#include <Eigen/SVD>
#include <cmath>

namespace portolan {
namespace {

// Below this squared angle the series are exact to double precision.
constexpr double kSmallAngleSquared = 1e-4;

}  // namespace

Eigen::Matrix3d Skew(const Eigen::Vector3d& v) {
  Eigen::Matrix3d skew;
  skew << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return skew;
}

Eigen::Quaterniond RotationExp(const Eigen::Vector3d& v) {
  const double angle_squared = v.squaredNorm();
  double real, imaginary_factor;  // cos(angle / 2), sin(angle / 2) / angle
  if (angle_squared < kSmallAngleSquared) {
    const double q = angle_squared / 4;
    real = 1 - q / 2 * (1 - q / 12 * (1 - q / 30));
    imaginary_factor = 0.5 * (1 - q / 6 * (1 - q / 20 * (1 - q / 42)));
  } else {
    const double angle = std::sqrt(angle_squared);
    real = std::cos(0.5 * angle);
    imaginary_factor = std::sin(0.5 * angle) / angle;
  }
  return Eigen::Quaterniond(real, imaginary_factor * v.x(), imaginary_factor * v.y(),
                            imaginary_factor * v.z());
}

Eigen::Vector3d RotationLog(const Eigen::Quaterniond& q) {
  // q and -q are the same rotation; the one with real part >= 0 has the angle <= pi.
  const double sign = q.w() < 0 ? -1.0 : 1.0;
  const double sine = q.vec().norm();
  const double cosine = sign * q.w();
  // angle / sin(angle / 2); for small ones 2 asin(s)/s = 2 + s^2/3 + ... of the normalised s.
  const double factor = sine < 1e-9 ? 2.0 / cosine : 2.0 * std::atan2(sine, cosine) / sine;
  return sign * factor * q.vec();
}

Eigen::Matrix3d RotationRightJacobian(const Eigen::Vector3d& v) {
  // Sola 2018, Eq. 143.
  const double angle_squared = v.squaredNorm();
  double a, b;  // (1 - cos) / angle^2, (angle - sin) / angle^3
  if (angle_squared < kSmallAngleSquared) {
    a = 0.5 - angle_squared / 24 * (1 - angle_squared / 30 * (1 - angle_squared / 56));
    b = 1.0 / 6 - angle_squared / 120 * (1 - angle_squared / 42 * (1 - angle_squared / 72));
  } else {
    const double angle = std::sqrt(angle_squared);
    const double half_sine = std::sin(0.5 * angle);
    a = 2 * half_sine * half_sine / angle_squared;
    b = (angle - std::sin(angle)) / (angle_squared * angle);
  }
  const Eigen::Matrix3d skew = Skew(v);
  return Eigen::Matrix3d::Identity() - a * skew + b * skew * skew;
}

Eigen::Matrix3d RotationRightJacobianInverse(const Eigen::Vector3d& v) {
  // Sola 2018, Eq. 144, with (1 + cos) / sin = cot(angle / 2), which has no pole at pi.
  const double angle_squared = v.squaredNorm();
  double c;
  if (angle_squared < kSmallAngleSquared) {
    c = 1.0 / 12 + angle_squared / 720 * (1 + angle_squared / 42 * (1 + angle_squared / 40));
  } else {
    const double half = 0.5 * std::sqrt(angle_squared);
    c = (1 - half * std::cos(half) / std::sin(half)) / angle_squared;
  }
  const Eigen::Matrix3d skew = Skew(v);
  return Eigen::Matrix3d::Identity() + 0.5 * skew + c * skew * skew;
}

Eigen::Quaterniond RotationBetween(const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
  const Eigen::Vector3d a = from.normalized(), b = to.normalized();
  const double cosine = a.dot(b);
  Eigen::Quaterniond rotation;
  if (cosine < -1 + 1e-12) {
    rotation.w() = 0;
    rotation.vec() = a.unitOrthogonal();
    return rotation;
  }
  const double twice_w = std::sqrt(2 * (1 + cosine));
  rotation.w() = 0.5 * twice_w;
  rotation.vec() = a.cross(b) / twice_w;
  return rotation;
}

Eigen::Matrix2d NearestRotation(const Eigen::Matrix2d& m) {
  const double angle = std::atan2(m(1, 0) - m(0, 1), m(0, 0) + m(1, 1));
  return Eigen::Rotation2Dd(angle).toRotationMatrix();
}

Eigen::Matrix3d NearestRotation(const Eigen::Matrix3d& m) {
  const Eigen::JacobiSVD<Eigen::Matrix3d, Eigen::NoQRPreconditioner> svd(
      m, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Eigen::Matrix3d v = svd.matrixV();
  Eigen::Matrix3d u = svd.matrixU();
  if (u.determinant() * v.determinant() < 0) u.col(2) = -u.col(2);
  return u * v.transpose();
}

}  // namespace portolan
