#include "common/geometry/similarity3.h"

#include <Eigen/LU>
#include <array>
#include <cmath>

namespace portolan {
namespace {

// The integrals of t^n exp(sigma t) over t in [0, 1], n = 0 .. 6.
std::array<double, 7> ExponentialMoments(double sigma) {
  std::array<double, 7> moments;
  if (std::abs(sigma) < 1.0) {
    for (int n = 0; n < 7; ++n) {
      double sum = 0, term = 1;  // term = sigma^k / k!
      for (int k = 0; k < 20; ++k) {
        sum += term / (n + k + 1);
        term *= sigma / (k + 1);
      }
      moments[n] = sum;
    }
  } else {
    moments[0] = std::expm1(sigma) / sigma;
    for (int n = 1; n < 7; ++n) moments[n] = (std::exp(sigma) - n * moments[n - 1]) / sigma;
  }
  return moments;
}

// W with translation = W * (tangent translation): the integral of exp(sigma t) Exp(v t) over t in
// [0, 1] (Strasdat 2012, Sec. 2.4; here with all small cases as series in the angle).
Eigen::Matrix3d TranslationJacobian(const Eigen::Vector3d& v, double sigma) {
  const double angle_squared = v.squaredNorm();
  double a, b, c;  // factors of [v]x, [v]x^2 and the identity
  if (angle_squared < 1e-4) {
    const std::array<double, 7> m = ExponentialMoments(sigma);
    a = m[1] - angle_squared / 6 * (m[3] - angle_squared / 20 * m[5]);
    b = m[2] / 2 - angle_squared / 24 * (m[4] - angle_squared / 30 * m[6]);
    c = m[0];
  } else {
    const double angle = std::sqrt(angle_squared);
    const double scale = std::exp(sigma), denominator = sigma * sigma + angle_squared;
    const double sine = std::sin(angle), cosine = std::cos(angle);
    c = std::abs(sigma) < 1e-12 ? 1.0 : std::expm1(sigma) / sigma;
    const double cosine_integral = (scale * (sigma * cosine + angle * sine) - sigma) / denominator;
    a = (scale * (sigma * sine - angle * cosine) + angle) / (denominator * angle);
    b = (c - cosine_integral) / angle_squared;
  }
  const Eigen::Matrix3d skew = Skew(v);
  return c * Eigen::Matrix3d::Identity() + a * skew + b * skew * skew;
}

}  // namespace

Similarity3 Similarity3::FromRigid(const Rigid3& rigid, double scale) {
  return {scale, rigid.rotation, rigid.translation};
}

Similarity3 Similarity3::Exp(const Vector7d& tangent) {
  const Eigen::Vector3d angle = tangent.segment<3>(3);
  const double sigma = tangent[6];
  return {std::exp(sigma), RotationExp(angle),
          TranslationJacobian(angle, sigma) * tangent.head<3>()};
}

Vector7d Similarity3::Log() const {
  const Eigen::Vector3d angle = RotationLog(rotation);
  const double sigma = std::log(scale);
  Vector7d tangent;
  tangent << TranslationJacobian(angle, sigma).inverse() * translation, angle, sigma;
  return tangent;
}

Similarity3 Similarity3::Inverse() const {
  const Eigen::Quaterniond inverse = rotation.conjugate();
  return {1.0 / scale, inverse, inverse * translation / -scale};
}

Matrix7d Similarity3::Adjoint() const {
  const Eigen::Matrix3d r = rotation.toRotationMatrix();
  Matrix7d adjoint = Matrix7d::Zero();
  adjoint.block<3, 3>(0, 0) = scale * r;
  adjoint.block<3, 3>(0, 3) = Skew(translation) * r;
  adjoint.block<3, 1>(0, 6) = -translation;
  adjoint.block<3, 3>(3, 3) = r;
  adjoint(6, 6) = 1.0;
  return adjoint;
}

Similarity3 operator*(const Similarity3& a_from_b, const Similarity3& b_from_c) {
  return {a_from_b.scale * b_from_c.scale, (a_from_b.rotation * b_from_c.rotation).normalized(),
          a_from_b * b_from_c.translation};
}

Rigid3 operator*(const Similarity3& a_from_b, const Rigid3& b_from_c) {
  return {(a_from_b.rotation * b_from_c.rotation).normalized(), a_from_b * b_from_c.translation};
}

}  // namespace portolan
