#include "common/camera/camera_model.h"

#include <algorithm>
#include <cmath>
#include <span>
#include <vector>

#include "absl/strings/str_cat.h"

namespace portolan {
namespace {

// Rays closer than about 0.6 degrees to the image plane have no meaning in a pinhole camera.
constexpr double kMaxRadiusSquared = 1e4;
constexpr double kMaxAngleRad = 1.5606;  // the same for the fisheye
constexpr int kMaxIterations = 30;
// Residual on the normalised plane at which the iteration stops; far below 1e-6 px.
constexpr double kConvergence = 1e-13;
constexpr double kMaxReprojectionErrorPx = 1e-6;

double EvaluatePolynomial(std::span<const double> coefficients, double x) {
  double value = 0;
  for (size_t i = coefficients.size(); i-- > 0;) value = value * x + coefficients[i];
  return value;
}

double Bisect(std::span<const double> coefficients, double low, double high) {
  const bool low_is_negative = EvaluatePolynomial(coefficients, low) < 0;
  for (int i = 0; i < 100; ++i) {
    const double middle = 0.5 * (low + high);
    ((EvaluatePolynomial(coefficients, middle) < 0) == low_is_negative ? low : high) = middle;
  }
  return low;
}

// The roots of odd order in [low, high], ascending: between two roots of the derivative a
// polynomial is monotonic.
std::vector<double> RootsBetween(std::span<const double> coefficients, double low, double high) {
  std::vector<double> roots;
  if (coefficients.size() < 2) return roots;
  std::vector<double> derivative;
  for (size_t i = 1; i < coefficients.size(); ++i) derivative.push_back(i * coefficients[i]);
  std::vector<double> bounds = RootsBetween(derivative, low, high);
  bounds.insert(bounds.begin(), low);
  bounds.push_back(high);
  for (size_t i = 0; i + 1 < bounds.size(); ++i) {
    if ((EvaluatePolynomial(coefficients, bounds[i]) < 0) !=
        (EvaluatePolynomial(coefficients, bounds[i + 1]) < 0)) {
      roots.push_back(Bisect(coefficients, bounds[i], bounds[i + 1]));
    }
  }
  return roots;
}

// See CameraModel::valid_limit_.
double MonotonicLimit(const CameraIntrinsics& intrinsics) {
  const auto& k = intrinsics.coefficients;
  switch (intrinsics.distortion) {
    case DistortionModel::kNone:
      return kMaxRadiusSquared;
    case DistortionModel::kRadTan: {
      // Derivative of r (1 + k1 r^2 + k2 r^4 + k3 r^6), in powers of r^2.
      const std::array<double, 4> slope = {1, 3 * k[0], 5 * k[1], 7 * k[4]};
      const auto roots = RootsBetween(slope, 0, kMaxRadiusSquared);
      return roots.empty() ? kMaxRadiusSquared : roots.front();
    }
    case DistortionModel::kEquidistant: {
      const std::array<double, 5> slope = {1, 3 * k[0], 5 * k[1], 7 * k[2], 9 * k[3]};
      const auto roots = RootsBetween(slope, 0, kMaxAngleRad * kMaxAngleRad);
      return roots.empty() ? kMaxAngleRad : std::sqrt(roots.front());
    }
  }
  return 0;
}

// Brown-Conrady distortion of a point of the normalised plane, with its Jacobian.
struct DistortedPoint {
  Eigen::Vector2d point;
  double dx_dx, dx_dy, dy_dy;  // dy_dx == dx_dy
};

inline DistortedPoint DistortRadTan(const std::array<double, 5>& k, double x, double y) {
  const double xx = x * x, yy = y * y, xy = x * y, rr = xx + yy;
  const double radial = 1 + rr * (k[0] + rr * (k[1] + rr * k[4]));
  const double slope = 2 * (k[0] + rr * (2 * k[1] + rr * 3 * k[4]));  // d radial / d rr * 2
  const double p1 = k[2], p2 = k[3];
  return {{x * radial + 2 * p1 * xy + p2 * (rr + 2 * xx),
           y * radial + p1 * (rr + 2 * yy) + 2 * p2 * xy},
          radial + slope * xx + 2 * p1 * y + 6 * p2 * x,
          slope * xy + 2 * p1 * x + 2 * p2 * y,
          radial + slope * yy + 6 * p1 * y + 2 * p2 * x};
}

// theta_d and its derivative for the angle theta.
inline double DistortAngle(const std::array<double, 5>& k, double theta, double* slope) {
  const double t = theta * theta;
  *slope = 1 + t * (3 * k[0] + t * (5 * k[1] + t * (7 * k[2] + t * 9 * k[3])));
  return theta * (1 + t * (k[0] + t * (k[1] + t * (k[2] + t * k[3]))));
}

// Newton's iteration with step halving on the normalised plane.
std::optional<Eigen::Vector2d> UndistortRadTan(const std::array<double, 5>& k, double limit,
                                               const Eigen::Vector2d& distorted) {
  Eigen::Vector2d x = distorted;
  // A start beyond the fold would converge to the false branch.
  if (x.squaredNorm() > 0.8 * limit) x *= std::sqrt(0.8 * limit / x.squaredNorm());
  DistortedPoint value = DistortRadTan(k, x.x(), x.y());
  Eigen::Vector2d residual = distorted - value.point;
  for (int i = 0; i < kMaxIterations && residual.squaredNorm() > kConvergence * kConvergence; ++i) {
    const double determinant = value.dx_dx * value.dy_dy - value.dx_dy * value.dx_dy;
    if (!(determinant > 1e-12)) return std::nullopt;
    Eigen::Vector2d step(value.dy_dy * residual.x() - value.dx_dy * residual.y(),
                         value.dx_dx * residual.y() - value.dx_dy * residual.x());
    step /= determinant;
    bool improved = false;
    for (int halving = 0; halving < 12 && !improved; ++halving, step *= 0.5) {
      const Eigen::Vector2d candidate = x + step;
      if (candidate.squaredNorm() > limit) continue;
      const DistortedPoint candidate_value = DistortRadTan(k, candidate.x(), candidate.y());
      const Eigen::Vector2d candidate_residual = distorted - candidate_value.point;
      if (!(candidate_residual.squaredNorm() < residual.squaredNorm())) continue;
      x = candidate;
      value = candidate_value;
      residual = candidate_residual;
      improved = true;
    }
    if (!improved) break;  // at rounding level, or at the fold; the caller checks which
  }
  return x;
}

// Newton's iteration inside a shrinking bracket; theta_d is increasing up to limit.
double UndistortAngle(const std::array<double, 5>& k, double limit, double distorted) {
  double low = 0, high = limit;
  double theta = std::min(distorted, limit);
  for (int i = 0; i < kMaxIterations; ++i) {
    double slope;
    const double error = DistortAngle(k, theta, &slope) - distorted;
    if (std::abs(error) <= kConvergence) break;
    (error > 0 ? high : low) = theta;
    const double next = theta - error / slope;
    theta = next > low && next < high ? next : 0.5 * (low + high);
  }
  return theta;
}

Status CheckFinite(const CameraIntrinsics& intrinsics) {
  const std::pair<const char*, double> named[] = {{"fx_px", intrinsics.fx_px},
                                                  {"fy_px", intrinsics.fy_px},
                                                  {"cx_px", intrinsics.cx_px},
                                                  {"cy_px", intrinsics.cy_px}};
  for (const auto& [name, value] : named) {
    if (!std::isfinite(value)) {
      return absl::InvalidArgumentError(absl::StrCat("camera ", name, " is not finite"));
    }
  }
  for (size_t i = 0; i < intrinsics.coefficients.size(); ++i) {
    if (!std::isfinite(intrinsics.coefficients[i])) {
      return absl::InvalidArgumentError(
          absl::StrCat("camera distortion coefficient ", i, " is not finite"));
    }
  }
  return absl::OkStatus();
}

Status CheckFields(const CameraIntrinsics& intrinsics) {
  if (intrinsics.width_px <= 0 || intrinsics.height_px <= 0) {
    return absl::InvalidArgumentError(absl::StrCat("camera width_px x height_px is ",
                                                   intrinsics.width_px, " x ", intrinsics.height_px,
                                                   ", must be positive"));
  }
  PORTOLAN_RETURN_IF_ERROR(CheckFinite(intrinsics));
  if (intrinsics.fx_px <= 0 || intrinsics.fy_px <= 0) {
    return absl::InvalidArgumentError(absl::StrCat("camera fx_px, fy_px is ", intrinsics.fx_px,
                                                   ", ", intrinsics.fy_px, ", must be positive"));
  }
  if (intrinsics.distortion != DistortionModel::kNone &&
      intrinsics.distortion != DistortionModel::kRadTan &&
      intrinsics.distortion != DistortionModel::kEquidistant) {
    return absl::InvalidArgumentError("camera distortion model is unknown");
  }
  return absl::OkStatus();
}

}  // namespace

StatusOr<CameraModel> CameraModel::Create(const CameraIntrinsics& intrinsics) {
  PORTOLAN_RETURN_IF_ERROR(CheckFields(intrinsics));
  CameraModel camera(intrinsics);
  camera.valid_limit_ = MonotonicLimit(intrinsics);
  const double right = intrinsics.width_px - 1, bottom = intrinsics.height_px - 1;
  std::vector<Eigen::Vector2d> needed = {{0.5 * right, 0.5 * bottom}};
  if (intrinsics.distortion == DistortionModel::kEquidistant) {
    // The corners of a fisheye image may lie outside the image circle: the nearest edge decides.
    if (camera.valid_limit_ < kMaxAngleRad) {
      if (intrinsics.width_px < intrinsics.height_px) {
        needed.insert(needed.end(), {{0, 0.5 * bottom}, {right, 0.5 * bottom}});
      } else {
        needed.insert(needed.end(), {{0.5 * right, 0}, {0.5 * right, bottom}});
      }
    }
  } else {
    needed.insert(needed.end(), {{0, 0}, {right, 0}, {0, bottom}, {right, bottom}});
  }
  for (const Eigen::Vector2d& pixel : needed) {
    if (!camera.Unproject(pixel)) {
      return absl::InvalidArgumentError(
          absl::StrCat("camera distortion is not invertible at pixel (", pixel.x(), ", ", pixel.y(),
                       "); check the coefficients and the image size"));
    }
  }
  return camera;
}

std::optional<Eigen::Vector2d> CameraModel::Project(const Eigen::Vector3d& point_in_camera,
                                                    Matrix23d* d_pixel_d_point_in_camera) const {
  const double x = point_in_camera.x(), y = point_in_camera.y(), z = point_in_camera.z();
  if (!(z > 0)) return std::nullopt;
  const double fx = intrinsics_.fx_px, fy = intrinsics_.fy_px;
  const Eigen::Vector2d centre(intrinsics_.cx_px, intrinsics_.cy_px);
  const auto& k = intrinsics_.coefficients;

  if (intrinsics_.distortion == DistortionModel::kEquidistant) {
    const double rr = x * x + y * y, nn = rr + z * z, r = std::sqrt(rr);
    const double theta = std::atan2(r, z);
    if (!(theta <= valid_limit_)) return std::nullopt;
    double slope;
    const double theta_d = DistortAngle(k, theta, &slope);
    const bool on_axis = rr < 1e-18 * z * z;
    const double s = on_axis ? 1.0 / z : theta_d / r;
    if (d_pixel_d_point_in_camera != nullptr) {
      // d s / d x = x * bend, d (s x) / d z = -x slope / |p|^2.
      const double bend = on_axis ? 0.0 : (slope * z / nn - s) / rr;
      const double along = -slope / nn;
      *d_pixel_d_point_in_camera << fx * (s + x * x * bend), fx * x * y * bend, fx * x * along,
          fy * x * y * bend, fy * (s + y * y * bend), fy * y * along;
    }
    return Eigen::Vector2d(fx * s * x, fy * s * y) + centre;
  }

  const double inverse_z = 1.0 / z;
  const double u = x * inverse_z, v = y * inverse_z;
  if (!(u * u + v * v <= valid_limit_)) return std::nullopt;
  const DistortedPoint d = intrinsics_.distortion == DistortionModel::kNone
                               ? DistortedPoint{{u, v}, 1, 0, 1}
                               : DistortRadTan(k, u, v);
  if (d_pixel_d_point_in_camera != nullptr) {
    const double ax = fx * inverse_z, ay = fy * inverse_z;
    *d_pixel_d_point_in_camera << ax * d.dx_dx, ax * d.dx_dy, -ax * (d.dx_dx * u + d.dx_dy * v),
        ay * d.dx_dy, ay * d.dy_dy, -ay * (d.dx_dy * u + d.dy_dy * v);
  }
  return Eigen::Vector2d(fx * d.point.x(), fy * d.point.y()) + centre;
}

std::optional<Eigen::Vector3d> CameraModel::Unproject(const Eigen::Vector2d& pixel) const {
  const auto& k = intrinsics_.coefficients;
  const Eigen::Vector2d distorted((pixel.x() - intrinsics_.cx_px) / intrinsics_.fx_px,
                                  (pixel.y() - intrinsics_.cy_px) / intrinsics_.fy_px);
  if (!distorted.allFinite()) return std::nullopt;
  Eigen::Vector3d bearing;
  if (intrinsics_.distortion == DistortionModel::kEquidistant) {
    const double theta_d = distorted.norm();
    const double theta = UndistortAngle(k, valid_limit_, theta_d);
    const double factor = theta_d < 1e-12 ? 1.0 : std::sin(theta) / theta_d;
    bearing << factor * distorted, std::cos(theta);
  } else if (intrinsics_.distortion == DistortionModel::kRadTan) {
    const auto undistorted = UndistortRadTan(k, valid_limit_, distorted);
    if (!undistorted) return std::nullopt;
    bearing << *undistorted, 1.0;
  } else {
    bearing << distorted, 1.0;
  }
  const auto back = Project(bearing);
  if (!back ||
      !((*back - pixel).squaredNorm() <= kMaxReprojectionErrorPx * kMaxReprojectionErrorPx)) {
    return std::nullopt;
  }
  return bearing.normalized();
}

bool CameraModel::has_distortion() const {
  const auto& k = intrinsics_.coefficients;
  return intrinsics_.distortion != DistortionModel::kNone &&
         std::any_of(k.begin(), k.end(), [](double coefficient) { return coefficient != 0; });
}

Eigen::Matrix2d CameraModel::DPixelDRadial(const Eigen::Vector3d& point_in_camera) const {
  const double x = point_in_camera.x(), y = point_in_camera.y(), z = point_in_camera.z();
  if (!(z > 0)) return Eigen::Matrix2d::Zero();
  // Along the ray's image, by k1 and k2: r^3 and r^5, or the angle's third and fifth power.
  Eigen::Vector2d outwards(x / z, y / z);
  double square = outwards.squaredNorm();
  if (intrinsics_.distortion == DistortionModel::kEquidistant) {
    const double r = std::sqrt(square), theta = std::atan(r);
    outwards *= r > 0 ? theta / r : 0.0;
    square = theta * theta;
  }
  if (!(square <= kMaxRadiusSquared)) return Eigen::Matrix2d::Zero();
  const Eigen::Vector2d scaled(intrinsics_.fx_px * outwards.x(), intrinsics_.fy_px * outwards.y());
  Eigen::Matrix2d derivative;
  derivative << scaled * square, scaled * (square * square);
  return derivative;
}

StatusOr<CameraModel> CameraModel::WithRadial(const Eigen::Vector2d& added) const {
  CameraIntrinsics changed = intrinsics_;
  if (changed.distortion == DistortionModel::kNone) {
    changed.distortion = DistortionModel::kRadTan;
    changed.coefficients = {};
  }
  changed.coefficients[0] += added.x();
  changed.coefficients[1] += added.y();
  return Create(changed);
}

bool CameraModel::IsInImage(const Eigen::Vector2d& pixel, double border_px) const {
  return pixel.x() >= border_px && pixel.y() >= border_px &&
         pixel.x() <= intrinsics_.width_px - 1 - border_px &&
         pixel.y() <= intrinsics_.height_px - 1 - border_px;
}

}  // namespace portolan
