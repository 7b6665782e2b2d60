#include "server/verification/three_point_pose.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

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

// Positive real roots by the companion matrix; nearly double ones may be complex by rounding, so
// a small imaginary part is dropped.
std::vector<double> PositiveRoots(const Eigen::Matrix<double, 5, 1>& q) {
  if (!q.allFinite() || std::abs(q[4]) < 1e-12 * q.cwiseAbs().maxCoeff()) return {};
  Eigen::Matrix4d companion = Eigen::Matrix4d::Zero();
  companion.diagonal<-1>().setOnes();
  companion.col(3) = -q.head<4>() / q[4];
  const Eigen::EigenSolver<Eigen::Matrix4d> solver(companion, false);
  if (solver.info() != Eigen::Success) return {};
  std::vector<double> roots;
  for (int i = 0; i < 4; ++i) {
    const auto root = solver.eigenvalues()[i];
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
    const Eigen::Vector3d step = jacobian.partialPivLu().solve(residual);
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
  const Eigen::Matrix4d matrix = Eigen::umeyama(points_in_b, points_in_a, !fixed_scale);
  if (!matrix.allFinite()) return std::nullopt;
  Similarity3 a_from_b;
  a_from_b.scale = fixed_scale ? 1.0 : std::cbrt(matrix.topLeftCorner<3, 3>().determinant());
  if (!(a_from_b.scale > 1e-9)) return std::nullopt;
  const Eigen::Matrix3d rotation = matrix.topLeftCorner<3, 3>() / a_from_b.scale;
  a_from_b.rotation = Eigen::Quaterniond(rotation).normalized();
  a_from_b.translation = matrix.topRightCorner<3, 1>();
  return a_from_b;
}

}  // namespace portolan
