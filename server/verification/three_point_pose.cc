#include "server/verification/three_point_pose.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>

namespace portolan {
namespace {

// Twice the triangle's area over its longest side squared; under this it counts as a line.
constexpr double kLeastRelativeHeight = 1e-3;

bool IsLine(const ThreePoints& points) {
  const Eigen::Vector3d u = points.col(1) - points.col(0);
  const Eigen::Vector3d v = points.col(2) - points.col(0);
  const double longest = std::max({u.squaredNorm(), v.squaredNorm(), (u - v).squaredNorm()});
  return !(u.cross(v).norm() > kLeastRelativeHeight * longest);
}

// The angles' cosines and the squared sides: index i belongs to the pair opposite to point i.
struct Triangle {
  Eigen::Vector3d cosines;
  Eigen::Vector3d squared_sides;
};

Triangle MakeTriangle(const ThreePoints& points, const ThreePoints& bearings) {
  Triangle triangle;
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    triangle.cosines[i] = bearings.col(j).dot(bearings.col(k));
    triangle.squared_sides[i] = (points.col(j) - points.col(k)).squaredNorm();
  }
  return triangle;
}

// Coefficients, constant first, of the quartic in v = depth 3 / depth 1 (Haralick 1994, Eq. 9).
Eigen::Matrix<double, 5, 1> GrunertQuartic(const Triangle& t) {
  const double ca = t.cosines[0], cb = t.cosines[1], cg = t.cosines[2];
  const double a = t.squared_sides[0] / t.squared_sides[1];
  const double c = t.squared_sides[2] / t.squared_sides[1];
  const double minus = a - c, plus = a + c;
  Eigen::Matrix<double, 5, 1> q;
  q[4] = (minus - 1) * (minus - 1) - 4 * c * ca * ca;
  q[3] = 4 * (minus * (1 - minus) * cb - (1 - plus) * ca * cg + 2 * c * ca * ca * cb);
  q[2] = 2 * (minus * minus - 1 + 2 * minus * minus * cb * cb + 2 * (1 - c) * ca * ca -
              4 * plus * ca * cb * cg + 2 * (1 - a) * cg * cg);
  q[1] = 4 * (-minus * (1 + minus) * cb + 2 * a * cg * cg * cb - (1 - plus) * ca * cg);
  q[0] = (1 + minus) * (1 + minus) - 4 * a * cg * cg;
  return q;
}

// All roots of x^4 + c[3] x^3 + c[2] x^2 + c[1] x + c[0] at once (Weierstrass's iteration, Kerner,
// Numer. Math. 8, 1966): quadratic convergence, linear to multiple roots.
std::array<std::complex<double>, 4> QuarticRoots(const Eigen::Vector4d& c) {
  constexpr int kMostIterations = 60;
  constexpr double kPrecision = 1e-14;
  double radius = 0;  // no root is beyond twice this
  for (int i = 0; i < 4; ++i) radius = std::max(radius, std::pow(std::abs(c[i]), 1.0 / (4 - i)));
  std::array<std::complex<double>, 4> roots;
  for (int i = 0; i < 4; ++i) roots[i] = std::polar(radius, 0.4 + i * 0.5 * std::numbers::pi);
  double largest_step = radius;
  for (int k = 0; k < kMostIterations && largest_step > kPrecision * radius; ++k) {
    largest_step = 0;
    for (std::complex<double>& x : roots) {
      std::complex<double> others = 1;
      for (const std::complex<double>& other : roots) {
        if (&other != &x) others *= x - other;
      }
      if (others == 0.0) continue;
      const std::complex<double> step = ((((x + c[3]) * x + c[2]) * x + c[1]) * x + c[0]) / others;
      x -= step;
      largest_step = std::max(largest_step, std::abs(step));
    }
  }
  return roots;
}

// Positive real roots; nearly double ones may be complex by rounding, so a small imaginary part is
// dropped.
std::vector<double> PositiveRoots(const Eigen::Matrix<double, 5, 1>& q) {
  if (!q.allFinite() || std::abs(q[4]) < 1e-12 * q.cwiseAbs().maxCoeff()) return {};
  std::vector<double> roots;
  for (const std::complex<double>& root : QuarticRoots(q.head<4>() / q[4])) {
    if (root.real() > 0 && std::abs(root.imag()) < 1e-4 * std::abs(root)) {
      roots.push_back(root.real());
    }
  }
  return roots;
}

// Depths of the three points for a root of the quartic (Haralick 1994, Eq. 8 and 4).
std::optional<Eigen::Vector3d> DepthsOf(double v, const Triangle& t) {
  const double ca = t.cosines[0], cb = t.cosines[1], cg = t.cosines[2];
  const double minus = (t.squared_sides[0] - t.squared_sides[2]) / t.squared_sides[1];
  const double denominator = 2 * (cg - v * ca);
  if (std::abs(denominator) < 1e-12) return std::nullopt;
  const double u = ((minus - 1) * v * v - 2 * minus * cb * v + 1 + minus) / denominator;
  const double squared = t.squared_sides[1] / (1 + v * v - 2 * v * cb);
  if (!(u > 0) || !(squared > 0)) return std::nullopt;
  const double first = std::sqrt(squared);
  return Eigen::Vector3d(first, u * first, v * first);
}

// Newton on the three laws of cosines; false if they cannot be met.
bool PolishDepths(const Triangle& t, Eigen::Vector3d* depths) {
  Eigen::Vector3d residual;
  for (int iteration = 0; iteration < 4; ++iteration) {
    Eigen::Matrix3d jacobian = Eigen::Matrix3d::Zero();
    for (int i = 0; i < 3; ++i) {
      const int j = (i + 1) % 3, k = (i + 2) % 3;
      const double dj = (*depths)[j], dk = (*depths)[k];
      residual[i] = dj * dj + dk * dk - 2 * dj * dk * t.cosines[i] - t.squared_sides[i];
      jacobian(i, j) = 2 * (dj - dk * t.cosines[i]);
      jacobian(i, k) = 2 * (dk - dj * t.cosines[i]);
    }
    if (iteration == 3) break;
    const Eigen::Vector3d step = jacobian.inverse() * residual;
    if (!step.allFinite()) return false;
    *depths -= step;
  }
  return depths->minCoeff() > 0 &&
         residual.cwiseAbs().maxCoeff() < 1e-6 * t.squared_sides.maxCoeff();
}

// An orthonormal frame of a triangle.
Eigen::Matrix3d Frame(const ThreePoints& points) {
  const Eigen::Vector3d x = (points.col(1) - points.col(0)).normalized();
  const Eigen::Vector3d z = x.cross(points.col(2) - points.col(0)).normalized();
  Eigen::Matrix3d frame;
  frame << x, z.cross(x), z;
  return frame;
}

}  // namespace

std::vector<Rigid3> SolveThreePointPose(const ThreePoints& points_in_world,
                                        const ThreePoints& bearings_in_camera) {
  if (IsLine(points_in_world)) return {};
  const Triangle triangle = MakeTriangle(points_in_world, bearings_in_camera);
  const Eigen::Matrix3d frame_in_world = Frame(points_in_world);
  std::vector<Rigid3> poses;
  for (const double root : PositiveRoots(GrunertQuartic(triangle))) {
    std::optional<Eigen::Vector3d> depths = DepthsOf(root, triangle);
    if (!depths || !PolishDepths(triangle, &*depths)) continue;
    const ThreePoints points_in_camera = bearings_in_camera * depths->asDiagonal();
    Rigid3 world_from_camera;
    world_from_camera.rotation =
        Eigen::Quaterniond(frame_in_world * Frame(points_in_camera).transpose()).normalized();
    world_from_camera.translation =
        points_in_world.col(0) - world_from_camera.rotation * points_in_camera.col(0);
    poses.push_back(world_from_camera);
  }
  return poses;
}

std::optional<Similarity3> AlignThreePoints(const ThreePoints& points_in_a,
                                            const ThreePoints& points_in_b, bool fixed_scale) {
  if (IsLine(points_in_a) || IsLine(points_in_b)) return std::nullopt;
  // Umeyama, PAMI 1991, Eq. 38 to 42.
  const Eigen::Vector3d mean_a = points_in_a.rowwise().mean(),
                        mean_b = points_in_b.rowwise().mean();
  const Eigen::Matrix3d centred_b = points_in_b.colwise() - mean_b;
  const Eigen::Matrix3d covariance = (points_in_a.colwise() - mean_a) * centred_b.transpose();
  if (!covariance.allFinite()) return std::nullopt;
  const Eigen::Matrix3d rotation = NearestRotation(covariance);
  Similarity3 a_from_b;
  if (!fixed_scale) {
    a_from_b.scale = rotation.cwiseProduct(covariance).sum() / centred_b.squaredNorm();
  }
  if (!(a_from_b.scale > 1e-9)) return std::nullopt;
  a_from_b.rotation = Eigen::Quaterniond(rotation).normalized();
  a_from_b.translation = mean_a - a_from_b.scale * (rotation * mean_b);
  return a_from_b;
}

}  // namespace portolan
